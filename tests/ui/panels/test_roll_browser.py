"""The roll browser: all rolls in a picture, poses, margins, what is too close, certificate."""

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.dependencies.staleness import input_digests, session_obstacles
from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.steps.boundaries.ascan_view import scan_number_at, scan_poses
from rona_core.app.steps.roll.certificate_view import NO_CLEARANCE, certificate_view
from rona_core.app.steps.roll.messages import ChooseRoll
from rona_core.app.steps.roll.view import (
    RollStrip,
    joint_curves,
    none_works,
    path_margins,
    place_of_roll,
    ranked_ways,
    roll_strip,
)
from rona_core.app.steps.scan.planned_motion import joints_at
from rona_core.app.steps.setup.clearance import clearance_violations, drawn_obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.verification.verifier import verify_scan
from rona_core.session.document import Session
from rona_ui.panels.roll.joints_graph import joint_data
from rona_ui.panels.roll.roll import ChecksPanel, RollPanel
from rona_ui.panels.roll.roll_browser import (
    RollRanking,
    RollsPanel,
    bar,
    column_shown,
    curve_lines,
    end_words,
    legend,
    margin_words,
    roll_image,
    roll_picture,
)
from rona_ui.presentation.camera import STEP_PRESETS
from rona_ui.presentation.colors import GREEN, VERMILLION, css, viridis
from rona_ui.presentation.snapshot import MARGIN_SCALE_MAX, shown_joints
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.line_colors import sent_colors
from rona_ui.scene.roll import PATH, STOP, WORDS, MarginsLayer
from rona_ui.scene.setup.robot import RED, ROOT, ClearanceLayer, ObstaclesLayer, highlighted_parts
from rona_ui.scene.viser_nodes import SceneNodes
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot

ROLL = ViewState(step="roll")


class FakeScene:
    """Keeps what is drawn by name."""

    def __init__(self) -> None:
        self.nodes: dict[str, SimpleNamespace] = {}

    def __getattr__(self, kind: str) -> Any:
        def add(name: str, *values: Any, **options: Any) -> SimpleNamespace:
            node = SimpleNamespace(kind=kind, values=values, visible=True, **options)
            node.remove = lambda: self.nodes.pop(name)
            self.nodes[name] = node
            return node

        return add


@pytest.fixture(scope="module")
def refused(demo: Session) -> Session:
    """The same plan, looked at by the verifier where more room is demanded than there is."""
    wider = replace(demo.setup.surroundings, head_margin_mm=45.0)
    session = replace(demo, setup=replace(demo.setup, surroundings=wider))
    derived = session.results.roll
    plan = derived.value  # type: ignore[union-attr]
    certificate = verify_scan(
        robot_model(plan.model),
        plan.trajectory,  # type: ignore[arg-type]
        plan.search.path,
        plan.search.rolls_rad,
        session.setup.devices.robot.scan_speed_mm_per_s,
        obstacles=session_obstacles(session),
    )
    value = replace(plan, certificate=certificate)
    made = replace(derived, value=value, inputs=input_digests("roll", session))  # type: ignore
    return replace(session, results=replace(session.results, roll=made))


def plan_of(session: Session) -> Any:
    return session.results.roll.value  # type: ignore[union-attr]


def failing_roll(session: Session) -> int:
    verdicts = plan_of(session).search.verdicts
    return next(i for i, v in enumerate(verdicts) if not v.feasible and v.index > 0)


def with_plan(session: Session, **parts: Any) -> Session:
    plan = plan_of(session)
    whole = {name: parts.pop(name) for name in ("trajectory", "certificate") if name in parts}
    changed = replace(plan, search=replace(plan.search, **parts), **whole)
    made = replace(session.results.roll, value=changed)  # type: ignore
    return replace(session, results=replace(session.results, roll=made))


def varying(session: Session) -> Session:
    """The plan with a roll that swings through 0 degrees along the path."""
    plan = plan_of(session)
    rolls_rad = np.linspace(np.deg2rad(-30.0), np.deg2rad(30.0), len(plan.search.path))
    verdict = replace(plan.search.verdicts[plan.search.chosen], sentence="Varying roll: works")
    return with_plan(session, mode="variable", varying=verdict, chosen=-1, rolls_rad=rolls_rad)


def a_strip(**parts: Any) -> RollStrip:
    rolls = np.arange(4) * 90.0
    feasible = np.array([True, False, False, True])
    room = np.array([[1.0, 0.5, -1.0, 2.0], [1.0, -0.2, -1.0, 2.0], [1.0, 0.4, -1.0, 2.0]])
    return replace(
        RollStrip(
            rolls_deg=rolls,
            feasible=feasible,
            node_room=room,
            reasons=("none", "limit", "reach", "none"),
            fails_at=np.array([1.0, 0.5, 0.0, 1.0]),
            chosen=0,
            curve_deg=np.zeros(3),
        ),
        **parts,
    )


def test_the_map_is_red_exactly_where_no_branch_has_room() -> None:
    strip = a_strip()
    image = roll_image(strip)
    np.testing.assert_array_equal((image == VERMILLION).all(axis=2), strip.node_room < 0.0)


def test_the_strip_tells_every_reason_by_colour_word_and_count() -> None:
    svg = roll_picture(a_strip())
    tops = re.findall(r'<rect x="[-\d.]+" width="10" height="80" fill="(#\w+)"', svg)
    assert len(tops) == 4
    assert tops[0] == tops[3] == css(GREEN)
    assert len(set(tops)) == 3
    words = legend(a_strip())
    assert "2 × feasible" in words
    assert "1 × joint limit" in words
    assert "1 × out of reach" in words
    assert "singularity" not in words
    assert svg.count('height="15" fill="#fff"') == 2  # one mark a roll that fails


def test_a_roll_that_leaves_at_one_edge_comes_back_at_the_other() -> None:
    (straight,) = curve_lines(a_strip(curve_deg=np.array([90.0, 90.0, 180.0])))
    np.testing.assert_allclose(straight[:, 0], [10.0, 10.0, 20.0])
    over = curve_lines(a_strip(curve_deg=np.array([20.0, 5.0, -10.0, -20.0])))
    assert [len(part) for part in over] == [2, 2]
    assert over[0][:, 0].max() < 5.0
    assert over[1][:, 0].min() > 35.0
    half = a_strip(rolls_deg=np.array([-90.0, -30.0, 30.0, 90.0]), curve_deg=np.zeros(3))
    (inside,) = curve_lines(half)
    np.testing.assert_allclose(inside[:, 0], 15.0)
    assert curve_lines(a_strip(curve_deg=np.zeros(0))) == []


def test_a_failing_roll_shows_the_pose_that_it_would_need_where_it_fails(demo: Session) -> None:
    plan, fails = plan_of(demo), failing_roll(demo)
    verdict, model = plan.search.verdicts[fails], robot_model(plan.model)
    at = snapshot(demo, view=replace(ROLL, shown_roll=fails))
    q_rad = shown_joints(at)
    assert q_rad is not None
    tip = (model.joint_poses(q_rad)[-1] @ model.T_flange_probe).translation
    gap = np.linalg.norm(plan.search.path.points_base[verdict.index] - tip)
    assert gap <= np.diff(plan.search.path.arc_length_mm()[plan.search.shown_points]).max()
    assert {link for link, _ in highlighted_parts(at)} >= {verdict.joint}
    moved = snapshot(demo, view=replace(ROLL, shown_roll=fails, place=1.0))
    q_end = shown_joints(moved)
    assert q_end is not None
    end = (model.joint_poses(q_end)[-1] @ model.T_flange_probe).translation
    np.testing.assert_allclose(end, plan.search.path.points_base[-1], atol=0.01)


def test_failing_spots_lie_on_the_joint_that_is_to_blame(demo: Session) -> None:
    fails = failing_roll(demo)
    curves = joint_curves(demo, fails)
    assert curves is not None
    assert curves.fails is not None
    assert curves.worst_joint
    for joint, column in ((0, curves.worst_joint), (curves.worst_joint, 1)):
        data, low, _ = joint_data(curves, joint, None)
        spots, line = data[-1], data[column]
        there = spots >= low
        assert 0 < there.sum() < len(there)
        np.testing.assert_array_equal(spots[there], line[there])
    other = curves.worst_joint % 6 + 1
    data, low, high = joint_data(curves, other, None)
    seen = data[-1][data[-1] >= low]
    assert (seen < low + 0.05 * (high - low)).all()  # along the bottom


def test_margins_are_those_of_the_search_and_of_the_verifier(demo: Session) -> None:
    plan, fails = plan_of(demo), failing_roll(demo)
    found = path_margins(demo, fails)
    assert found is not None
    np.testing.assert_allclose(found.room, plan.search.room[fails], atol=1e-5)
    np.testing.assert_array_equal(found.fails("limits"), found.limit_deg < 0.0)
    assert (found.room <= found.limit_deg / 20.0 + 1e-9).all()
    chosen = path_margins(demo, None)
    assert chosen is not None
    assert chosen is path_margins(demo, plan.search.chosen)
    assert chosen.room.min() == pytest.approx(
        plan.search.verdicts[plan.search.chosen].margin, abs=1e-6
    )
    assert plan.certificate.min_clearance_mm <= chosen.clearance_mm.min() + 0.5
    assert not chosen.collides.any()
    assert "Minimum along the path" in bar(chosen, "clearance")
    limits, clearance = chosen.limit_deg.min(), chosen.clearance_mm.min()
    told = margin_words(chosen)
    assert f"{limits:.1f}° from joint limits" in told
    assert f"clearance {clearance:.1f} mm" in told


def test_near_pairs_are_all_that_are_too_close_worst_first(refused: Session) -> None:
    q_rad = shown_joints(snapshot(refused, view=ROLL))
    assert q_rad is not None
    pairs = clearance_violations(refused, q_rad)
    assert pairs
    spare = [pair.distance_mm - pair.needed_mm for pair in pairs]
    assert spare == sorted(spare)
    assert all(pair.too_close and pair.second == "head" for pair in pairs)
    assert "45 mm must be kept" in pairs[0].sentence


def test_obstacles_are_meshes_that_face_outwards(demo: Session) -> None:
    things = {thing.name: thing.mesh for thing in drawn_obstacles(demo)}
    assert {"head", "table", "tracker stand"} <= set(things)
    assert "floor" not in things
    for name, mesh in things.items():
        corners = mesh.vertices[mesh.faces]
        volume = np.einsum("ij,ij->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]) / 6.0
        assert volume > 0.0, name
    table = demo.setup.surroundings.table_size_mm
    corners = things["table"].vertices[things["table"].faces]
    solid = np.einsum("ij,ij->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]) / 6.0
    assert solid == pytest.approx(np.prod(table))


def test_what_is_too_close_is_red_and_gets_its_own_colour_back(
    demo: Session, refused: Session
) -> None:
    scene = FakeScene()
    nodes = SceneNodes(scene)
    near, obstacles = ClearanceLayer(nodes), ObstaclesLayer(nodes)
    body = f"{ROOT}/link6/probe body"
    nodes.mesh(body, drawn_obstacles(demo)[0].mesh, (1, 2, 3))
    good, bad = snapshot(demo, view=ROLL), snapshot(refused, view=ROLL)
    near.render(None, bad)
    obstacles.render(None, bad)
    assert scene.nodes[body].color == RED
    head = scene.nodes["/obstacles/head"]
    assert head.color == RED
    assert head.visible
    assert not scene.nodes["/obstacles/table"].visible
    near.render(bad, good)
    obstacles.render(bad, good)
    assert scene.nodes[body].color != RED
    assert not head.visible
    wanted = replace(ROLL, hidden=ROLL.hidden - {"obstacles"})
    obstacles.render(good, snapshot(demo, view=wanted))
    assert head.visible
    assert head.color != RED
    assert scene.nodes["/obstacles/table"].visible


def test_the_path_is_drawn_by_margins_and_stops_where_the_roll_fails(demo: Session) -> None:
    fails, scene = failing_roll(demo), FakeScene()
    layer = MarginsLayer(SceneNodes(scene))
    plan = plan_of(demo)
    layer.render(None, snapshot(demo, view=replace(ROLL, shown_roll=fails)))
    colors = scene.nodes[PATH].colors
    assert (colors == sent_colors(VERMILLION)).all(axis=-1).any()
    stop = scene.nodes[STOP].points[0, 0] * 1000.0
    np.testing.assert_allclose(
        stop, plan.search.path.points_base[plan.search.verdicts[fails].index], atol=1e-3
    )
    assert f"joint {plan.search.verdicts[fails].joint}" in scene.nodes[WORDS].text
    layer.render(None, snapshot(demo, view=ROLL))
    assert STOP not in scene.nodes
    assert WORDS not in scene.nodes
    layer.render(None, snapshot(demo, view=ViewState(step="scan")))
    assert PATH not in scene.nodes


def test_the_slider_follows_a_varying_roll_and_one_click_leads_back(demo: Session) -> None:
    session, recorder, gui = varying(demo), Recorder(), FakeGui()
    panel = RollsPanel(gui, recorder.context)
    panel.render(None, snapshot(session, view=ROLL))
    rolls = [v.roll_deg for v in plan_of(session).search.verdicts]
    assert rolls[column_shown(snapshot(session, view=replace(ROLL, place=0.0))) or 0] == 330.0
    assert rolls[column_shown(snapshot(session, view=replace(ROLL, place=1.0))) or 0] == 30.0
    back = gui.find("button", "Show selected roll")
    assert not back.visible
    slider = gui.find("slider", "Roll")
    slider.value = failing_roll(demo)
    slider.happen(CLIENT)
    assert recorder.sent == []  # one that fails is looked at only
    assert recorder.shown.shown_roll == failing_roll(demo)
    panel.render(None, snapshot(session, view=replace(ROLL, shown_roll=3)))
    assert back.visible
    back.happen(CLIENT)
    assert recorder.shown.shown_roll is None


def test_the_map_and_the_path_in_the_scene_have_one_scale_of_margins(demo: Session) -> None:
    strip, path = roll_strip(demo), path_margins(demo, None)
    assert strip is not None
    assert strip.node_room.max() > MARGIN_SCALE_MAX["room"], "the case: beyond the scale"
    assert "margin, 0 to ≥ 2.0" in legend(strip)
    assert end_words(1.5, "room") == "2.0"
    assert ">2.0</span>" in bar(path, "room")
    most = np.unravel_index(int(strip.node_room.argmax()), strip.node_room.shape)
    assert (roll_image(strip)[most] == viridis(np.ones(1))[0]).all()


def test_moving_along_the_path_ends_the_replay(demo: Session) -> None:
    gui, recorder = FakeGui(), Recorder()
    recorder.shown = replace(ROLL, cursor=0.3, playing=True)
    RollsPanel(gui, recorder.context).render(None, snapshot(demo, view=ROLL))
    place = gui.find("slider", "Path position (%)")
    assert place.visible
    place.value = 80.0
    place.happen(CLIENT)
    after = recorder.shown
    assert (after.place, after.cursor, after.playing) == (0.8, None, False)


def test_the_ranking_plans_with_the_roll_and_branch_that_is_taken(demo: Session) -> None:
    gui, recorder = FakeGui(), Recorder()
    RollRanking(gui, recorder.context).render(None, snapshot(demo, view=ROLL))
    ways = ranked_ways(demo)
    assert [way.margin for way in ways] == sorted((w.margin for w in ways), reverse=True)
    choice = gui.find("dropdown", "Use")
    assert choice.value.startswith("1: ")  # the best one was chosen
    choice.value = choice.options[3]
    choice.happen(CLIENT)
    assert recorder.sent == [ChooseRoll(ways[2].index, ways[2].branch)]


def test_every_check_is_listed_with_value_limit_and_verdict(demo: Session) -> None:
    gui, recorder = FakeGui(), Recorder()
    ChecksPanel(gui, recorder.context).render(None, snapshot(demo, view=ROLL))
    html, checks = gui.html(), plan_of(demo).certificate.checks
    assert "Verified" in html
    assert html.count("pass") == len(checks)
    for check in checks:
        assert check.name in html
    view = certificate_view(demo)
    assert view is not None
    row = next(r for r in view.rows if r.check.name == "wrist from straight")
    choice = gui.find("dropdown", "Go to worst")
    choice.value = "wrist from straight"
    choice.happen(CLIENT)
    assert recorder.shown.cursor == row.share
    assert recorder.looks == [STEP_PRESETS["scan"] if row.path_percent is not None else "Robot"]
    assert row.path_percent is not None


def test_a_refused_plan_says_why_and_where_and_blocks_the_scan(refused: Session) -> None:
    gui, recorder = FakeGui(), Recorder()
    at = snapshot(refused, view=ROLL)
    ChecksPanel(gui, recorder.context).render(None, at)
    html = gui.html()
    assert "Refused" in html
    assert "clearance from the head" in html
    assert re.search(r"at \d+\.\d s, path \d+ %", html)
    assert "Verified" not in html
    failing = gui.find("dropdown", "Go to worst").options[1]
    assert failing == "✖ clearance from the head"  # what fails comes first
    panel = FakeGui()
    RollPanel(panel, recorder.context).render(None, at)
    assert "Refused: clearance from the head" in panel.html()
    assert NO_CLEARANCE not in html
    derived = refused.results.roll
    assert derived is not None
    seen = derived.value.certificate
    rows = tuple(one for one in seen.checks if not one.name.startswith("clearance"))
    hasty = replace(rows[0], name="joint speed", holds=False)
    unseen = replace(seen, checks=(hasty, *rows[1:]), min_clearance_mm=None)
    plan = replace(derived.value, certificate=unseen)
    results = replace(refused.results, roll=replace(derived, value=plan))
    ChecksPanel(gui, recorder.context).render(
        None, snapshot(replace(refused, results=results), view=ROLL)
    )
    assert NO_CLEARANCE in gui.html()
    states = {step.name: step for step in step_states(refused)}
    assert states["roll"].state == "ready"
    assert "refused by the verifier" in states["roll"].reason
    without = replace(refused, captures=replace(refused.captures, scan=None))
    assert {s.name: s.state for s in step_states(without)}["scan"] == "blocked"


def test_without_a_plan_the_best_roll_is_shown_and_the_words_say_what_is_missing(
    demo: Session,
) -> None:
    plan = plan_of(demo)
    nothing = with_plan(demo, mode="none", chosen=-1, trajectory=None, certificate=None)
    strip = roll_strip(nothing)
    assert strip is not None
    assert not len(strip.curve_deg)
    curves = joint_curves(nothing, None)
    assert curves is not None
    assert curves.roll_deg == plan.search.verdicts[plan.search.ranked[0].index].roll_deg
    assert "keep clear" in none_works(plan_of(nothing))
    verdicts = tuple(replace(v, feasible=False) for v in plan.search.verdicts)
    without = with_plan(nothing, verdicts=verdicts, ranked=())
    assert none_works(plan_of(without)).startswith(f"None of {len(verdicts)} rolls")
    assert place_of_roll(nothing, None) == 0.5


def test_the_a_scan_of_the_replay_was_taken_where_the_robot_is_drawn(demo: Session) -> None:
    plan, poses = plan_of(demo), scan_poses(demo)
    assert poses is not None
    motion, model = plan.trajectory, robot_model(plan.model)
    for part in np.linspace(0.05, 0.95, 7):
        time_s = motion.scan_start_s + part * (motion.scan_end_s - motion.scan_start_s)
        share = float(time_s / motion.times_s[-1])
        number, q_rad = scan_number_at(demo, share), joints_at(demo, share)
        assert number is not None
        assert q_rad is not None
        tip = (model.joint_poses(q_rad)[-1] @ model.T_flange_probe).translation
        away = np.linalg.norm(poses.translations - tip, axis=1)
        assert away[number] <= away.min() + 0.5
        assert number / len(poses) == pytest.approx(part, abs=0.1)


def test_a_varying_roll_needs_no_constant_one() -> None:
    for mode, verdict in (("constant", "fail"), ("variable", "none")):
        rows = quality_rows({"rolls_feasible": 0, "roll_mode": mode, "min_clearance_mm": 7.8})
        row = next(r for r in rows if r.key == "rolls_feasible")
        assert row.verdict == verdict
    assert next(r for r in rows if r.key == "min_clearance_mm").unit == "mm"
