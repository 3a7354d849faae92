"""How results look: the robot with a roll, lines in their colours, stale results unpraised."""

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from rona_core.app.dependencies.judge import step_states
from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.steps.maps.comparison import MapComparison
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_core.app.steps.maps.view import layers_of
from rona_core.devices.live import LiveState
from rona_core.mapping.accuracy.map_accuracy import accuracy_words
from rona_core.mapping.comparison.map_errors import MapErrors
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session
from rona_ui.panels.layout.quality import QualityPanel
from rona_ui.panels.maps.maps import MapsPanel, color_bar
from rona_ui.panels.widgets.form import PanelContext
from rona_ui.presentation.colors import BLUE, VERMILLION
from rona_ui.presentation.snapshot import (
    Snapshot,
    opening_step,
    opening_view,
    shown_joints,
    shows_roll_preview,
)
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.line_colors import sent_color
from rona_ui.scene.maps.maps import MapLayer, ScanLayer
from rona_ui.scene.path.path import SmoothLayer
from rona_ui.scene.viser_nodes import SceneNodes
from tests.helpers.ui.fake_gui import FakeGui

SCANNING = JobStatus("1", "StartScan", "running", 0.5)
NOTHING = PanelContext(*[lambda *_: None] * 5)  # type: ignore[arg-type]


def snapshot(session: Session, view: ViewState, **parts: Any) -> Snapshot:
    parts = {"judged": session, **parts}
    return Snapshot(session, view, step_states(session), LiveState(), **parts)


def test_a_session_opens_where_it_has_come_to_and_no_further_than_its_maps(demo: Session) -> None:
    assert opening_step(snapshot(demo, ViewState())) == "maps"
    assert opening_step(snapshot(Session(), ViewState())) == "setup"
    without = replace(demo.results, detection=None, maps=None)
    assert opening_step(snapshot(replace(demo, results=without), ViewState())) == "scan"


def test_a_step_that_is_chosen_before_the_session_is_drawn_stays(demo: Session) -> None:
    new = snapshot(demo, ViewState())
    last = snapshot(Session(), ViewState(step="tool"))
    tabs = frozenset(("Log",))
    opened = opening_view(last, new, ViewState(step="tool", open_tabs=tabs, cursor=0.5))
    assert (opened.step, opened.open_tabs, opened.cursor) == ("maps", tabs, None)
    assert opening_view(last, new, ViewState(step="path")).step == "path"
    assert opening_view(None, new, ViewState()).step == "maps"


def test_in_the_roll_step_the_probe_stands_on_the_middle_of_the_path(demo: Session) -> None:
    plan = demo.results.roll.value  # type: ignore[union-attr]
    model = robot_model(plan.model)
    index = next(
        i for i, v in enumerate(plan.search.verdicts) if v.feasible and i != plan.search.chosen
    )
    at = snapshot(demo, ViewState(step="roll", shown_roll=index))
    q_rad = shown_joints(at)
    assert shows_roll_preview(at)
    assert q_rad is not None
    T_base_flange = model.joint_poses(q_rad)[-1]
    tip_base = (T_base_flange @ model.T_flange_probe).translation
    along = np.linalg.norm(plan.search.path.points_base - tip_base, axis=1)
    assert along.min() < 0.01
    assert abs(along.argmin() / len(along) - 0.5) < 0.05


def test_elsewhere_and_while_it_scans_the_robot_stands_where_it_is(demo: Session) -> None:
    for other in (
        snapshot(demo, ViewState(step="scan")),
        snapshot(demo, ViewState(step="roll"), job=SCANNING),
    ):
        assert not shows_roll_preview(other)
        assert shown_joints(other) is None  # nothing is known of the robot


def test_a_line_keeps_the_one_colour_it_was_given() -> None:
    there: list[Any] = []

    def add(name: str, points: Any, colors: Any, **options: Any) -> Any:
        there.append(SimpleNamespace(points=points, colors=colors))
        return there[-1]

    nodes = SceneNodes(SimpleNamespace(add_line_segments=add))
    for n in (5, 8):
        nodes.lines("/line", np.zeros((n, 2, 3)), (230, 159, 0))
        (node,) = there
        assert node.points.shape == (n, 2, 3)
        assert np.asarray(node.colors).tolist() == sent_color((230, 159, 0)).tolist()


def test_a_colour_bar_says_where_values_lie_beyond_it(demo: Session) -> None:
    mapped = demo.results.maps
    assert mapped is not None
    layers = layers_of(mapped.value)
    assert "≤" in color_bar(replace(layers, low_mm=4.0))
    assert "≥" in color_bar(replace(layers, high_mm=5.0))
    whole = color_bar(replace(layers, low_mm=-1e3, high_mm=1e3))
    assert "≤" not in whole
    assert "≥" not in whole


def test_the_maps_say_how_far_off_they_are_expected_to_be(demo: Session) -> None:
    gui = FakeGui()
    MapsPanel(gui, NOTHING).render(None, snapshot(demo, ViewState(step="maps")))
    assert demo.results.maps is not None
    accuracy = map_accuracy(demo)
    assert accuracy is not None
    assert accuracy_words(demo.results.maps.value, accuracy) in gui.html()
    assert "Bone thickness (mm)" in gui.html()
    assert demo.results.detection is not None
    assert f"{demo.results.detection.value.bone_loss:.1f} times the published mean" in gui.html()
    MapsPanel(gui := FakeGui(), NOTHING).render(
        None, snapshot(demo, ViewState(step="maps", quantity="sigma"))
    )
    assert "Expected error, 1 σ (mm)" in gui.html()
    ticks = re.findall(r"(\d+\.\d+)</span>", gui.html())
    assert all(len(tick.split(".")[1]) == 2 for tick in ticks[-3:])  # hundredths
    assert 0.1 < float(ticks[-3]) < float(ticks[-1]) < 1.0


def test_the_maps_say_how_lossy_the_bone_is(demo: Session) -> None:
    detection = demo.results.detection
    assert detection is not None
    for loss, words in ((1.5, "13.1 dB/cm at 1 MHz ± 10 %"), (None, "Bone loss: not learned")):
        gui = FakeGui()
        value = replace(detection.value, bone_loss=loss)
        results = replace(demo.results, detection=replace(detection, value=value))
        shown = replace(demo, results=results)
        MapsPanel(gui, NOTHING).render(None, snapshot(shown, ViewState(step="maps")))
        assert words in gui.html()
        assert "published mean of 8.7" in gui.html()


def test_maps_are_drawn_in_the_colours_of_their_expected_error(demo: Session) -> None:
    drawn: dict[str, np.ndarray] = {}
    nodes: Any = SimpleNamespace(
        cloud=lambda name, points, colors, **_: drawn.__setitem__(name, np.asarray(colors)),
        show=lambda *_: None,
        remove=lambda *_: None,
    )
    layer = MapLayer(nodes, "inner")
    plain, sigma = (
        snapshot(demo, ViewState(step="maps", quantity=quantity))
        for quantity in ("thickness", "sigma")  # type: ignore[arg-type]
    )
    layer.render(None, plain)
    before = drawn["/maps/inner"]
    layer.render(plain, sigma)
    after = drawn["/maps/inner"]
    assert after.shape == before.shape  # the same cells
    assert (after != before).any()
    assert len(np.unique(after, axis=0)) > 20  # not one colour for all


def test_maps_are_drawn_in_the_colours_of_their_errors_where_a_reference_is_there(
    demo: Session,
) -> None:
    drawn: dict[str, np.ndarray] = {}
    nodes: Any = SimpleNamespace(
        cloud=lambda name, points, colors, **_: drawn.__setitem__(name, np.asarray(colors)),
        show=lambda *_: None,
        remove=lambda *_: None,
    )
    maps = demo.results.maps
    assert maps is not None
    errors = np.where(np.arange(maps.value.inner.ok.shape[1]) % 2, 0.3, -0.3)
    errors = np.broadcast_to(errors, maps.value.inner.ok.shape)
    found = MapComparison("bone.ply", maps.value, MapErrors({"inner": errors.copy()}), ())
    view = ViewState(step="maps", quantity="error")
    layer = MapLayer(nodes, "inner")
    layer.render(None, snapshot(demo, view, compared=found))
    assert {tuple(color) for color in drawn["/maps/inner"]} == {BLUE, VERMILLION}
    other = replace(found, maps=replace(maps.value))  # of maps that were made anew since
    layer.render(None, snapshot(demo, view, compared=other))
    assert len(drawn["/maps/inner"]) == 0


def test_a_stale_result_is_told_but_not_praised(demo: Session) -> None:
    for session, praised in (
        (demo, True),
        (replace(demo, setup=replace(demo.setup, seed=demo.setup.seed + 1)), False),
    ):
        gui = FakeGui()
        MapsPanel(gui, NOTHING).render(None, snapshot(session, ViewState(step="maps")))
        assert "Outer boundary in" in gui.html()
        assert ("r-note good" in gui.html()) == praised


def test_figures_of_stale_steps_are_marked(demo: Session) -> None:
    figures = {"tool_tip_error_mm": 0.2, "outer_rms_mm": 0.3}
    other = replace(demo, setup=replace(demo.setup, seed=demo.setup.seed + 1))
    for session, marks in ((demo, 0), (other, 4)):  # calibration, path, maps, burr
        gui = FakeGui()
        QualityPanel(gui).render(None, snapshot(session, ViewState(), figures=figures))
        assert gui.html().count("! stale") == marks


def test_points_of_the_scan_before_are_not_shown_while_the_robot_scans(demo: Session) -> None:
    shown: dict[str, bool] = {}

    def draw(name: str, *_: Any, **__: Any) -> None:
        shown[name] = True

    nodes: Any = SimpleNamespace(
        dots=draw,
        lines=draw,
        show=shown.__setitem__,
        names=shown.keys,
        remove=lambda name: shown.pop(name, None),
    )
    at_rest = snapshot(demo, ViewState(step="scan"))
    for at, scanning in ((at_rest, False), (replace(at_rest, job=SCANNING), True)):
        ScanLayer(nodes).render(None, at)
        SmoothLayer(nodes).render(None, at)
        assert shown["/scan/points"] != scanning
        assert shown["/path/smooth"] == scanning
