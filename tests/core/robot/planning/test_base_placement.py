"""Places of the base: frames and signs, laws of the screen, and what is suggested."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.settings import RobotSettings
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.geometry.path5d import Path5D, resample_path
from rona_core.geometry.pose import Pose
from rona_core.robot.base_placement.placement import place_base
from rona_core.robot.base_placement.reachability import (
    BasePlacement,
    BaseSearch,
    CoarseScreening,
    base_pose,
    path_from,
)
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan_motion import PlanSettings, plan_scan
from rona_core.robot.redundancy.margins import MarginLimits
from rona_core.session.codec import decode, digest, encode
from rona_core.virtual.scene import base_displacement
from tests.helpers.roll_search import search_rolls
from tests.scenes.patch_scenes import dense_path

RX90 = robot_model("rx90")


def around(count):
    """Rolls all around, evenly."""
    return tuple((360.0 * np.arange(count) / count).tolist())


SMALL = BaseSearch(half_x_mm=200.0, half_y_mm=200.0, n_points=30, rolls_deg=around(24))
QUICK = PlanSettings(n_rolls=36)


def quick(path, old_in_new):
    """Plan with a constant roll or not at all."""
    plan = plan_scan(path, RX90, QUICK)
    return plan if plan.search.mode == "constant" else replace(plan, trajectory=None)


def short(scene, half_mm=40.0):
    return dense_path(scene, lines=3, per_line=4, half_mm=half_mm)


@pytest.fixture(scope="module")
def refused():
    """S3 cannot be scanned with a constant roll from where the base stands."""
    path = short("S3")
    return path, place_base(path, RX90, RobotSettings(), search=SMALL, planner=quick)


def screening(path, margin_limits, n_points, n_rolls):
    search = BaseSearch(n_points=n_points, rolls_deg=around(n_rolls), margin_limits=margin_limits)
    return CoarseScreening(path, RX90, search)


def test_the_base_stands_where_the_scene_puts_it():
    robot = RobotSettings(base_shift_mm=(120.0, -40.0, 30.0), base_turn_deg=25.0)
    ours, theirs = base_pose(robot.base_shift_mm, robot.base_turn_deg), base_displacement(robot)
    np.testing.assert_allclose(ours.matrix(), theirs.matrix(), atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(shift=st.tuples(*[st.floats(-900, 900)] * 3), turn=st.floats(-180, 180))
def test_a_path_seen_from_another_place_and_back_is_the_same(shift, turn):
    path = short("S0")
    old_in_new = base_pose(shift, turn).inv()
    seen = path_from(path, old_in_new)
    back = path_from(seen, old_in_new.inv())
    np.testing.assert_allclose(back.points_base, path.points_base, atol=1e-9)
    np.testing.assert_allclose(back.axes_base, path.axes_base, atol=1e-12)
    inward = np.einsum("ij,ij->i", seen.axes_base[1:], np.diff(seen.points_base, axis=0))
    before = np.einsum("ij,ij->i", path.axes_base[1:], np.diff(path.points_base, axis=0))
    np.testing.assert_allclose(inward, before, atol=1e-9)


def test_a_base_moved_towards_the_path_sees_it_nearer():
    path = short("S0")
    seen = path_from(path, base_pose((100.0, 0.0, 50.0), 0.0).inv())
    np.testing.assert_allclose(
        seen.points_base - path.points_base, ((-100.0, 0, -50.0),) * len(path)
    )
    turned = path_from(path, base_pose((0.0, 0.0, 0.0), 90.0).inv())
    np.testing.assert_allclose(turned.points_base[:, 0], path.points_base[:, 1], atol=1e-9)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("scene", ["S0", "S1", "S3", "S5"])
def test_the_screen_with_every_point_and_roll_agrees_with_the_search(scene):
    """But for jumps, which the screen does not know of."""
    path = short(scene)
    margin_limits = MarginLimits(step_rad=3.0, step_unit_rad=1e-3)
    search = search_rolls(path, RX90, working_set=(24, 0.0, 360.0), margin_limits=margin_limits)
    best = max(verdict.margin for verdict in search.verdicts)
    margin = screening(path, margin_limits, len(path), 24).margin(Pose.identity())
    if best >= 0.0:
        assert margin == pytest.approx(best, abs=1e-9)
    else:
        assert margin < 0.0
    coarse = screening(path, margin_limits, 25, 24).margin(Pose.identity())
    assert coarse >= margin - 1e-9  # fewer points can only hide trouble


@settings(max_examples=15, deadline=None)
@given(turn=st.floats(-60.0, 60.0))
def test_turning_the_base_is_an_offset_of_joint_one(turn):
    screen = screening(short("S2"), MarginLimits(), 20, 12)
    straight = screen.margin(Pose.identity())
    turned = screen.margin(base_pose((0.0, 0.0, 0.0), turn).inv())
    assert turned == pytest.approx(straight, abs=1e-9)


def test_a_path_that_works_needs_no_move():
    path = short("S0")
    found = place_base(path, RX90, RobotSettings(), search=SMALL, planner=quick)
    assert found.here > 0.0
    assert found.smallest.moved_mm == 0.0
    assert found.smallest.turned_deg == 0.0
    assert found.smallest.shift_mm == (0.0, 0.0, 0.0)
    assert found.best.margin >= found.smallest.margin
    middle = len(found.x_mm) // 2, len(found.y_mm) // 2
    assert found.planned[middle]
    assert found.verified[middle]
    assert found.smallest.moved(RobotSettings()) == RobotSettings()


def test_what_is_refused_gets_suggestions_that_verify_on_the_dense_path(refused):
    path, found = refused
    assert found.here < 0.0
    assert not quick(path, None).may_move
    for place in (found.best, found.smallest):
        robot = place.moved(RobotSettings())
        old_in_new = base_displacement(robot).inv()
        plan = plan_scan(path_from(resample_path(path), old_in_new), RX90, QUICK)
        assert plan.may_move
        assert plan.search.n_feasible == place.n_feasible
        assert plan.search.mode == place.mode
        assert place.moved_mm == pytest.approx(np.linalg.norm(place.shift_mm))
    assert 0.0 < found.smallest.moved_mm <= found.best.moved_mm
    assert found.best.margin >= found.smallest.margin
    assert any("smallest move" in reason for reason in found.reasons)
    assert "from (0, 0, 0) mm" in " ".join(found.reasons)


def test_the_map_is_what_the_screen_says(refused):
    path, found = refused
    assert found.margins.shape == (len(found.x_mm), len(found.y_mm)) == (5, 5)
    assert found.margins.dtype == np.float32
    assert not (found.verified & ~found.planned).any()
    assert not (found.planned & found.blocked).any()
    screen = CoarseScreening(resample_path(path), RX90, SMALL)
    assert found.blocked.any()
    for i, j in np.argwhere(~found.blocked)[::3]:
        shift = (found.x_mm[i], found.y_mm[j], found.levels_mm[i, j])
        turn = float(np.round(found.turns_deg[i, j].astype(float), 1))
        margin = screen.margin(base_pose(shift, turn).inv())
        assert found.margins[i, j] == pytest.approx(margin, abs=1e-5)
        seen = path_from(path, base_pose(shift, turn).inv()).points_base.mean(axis=0)
        assert abs(np.rad2deg(np.arctan2(seen[1], seen[0]))) < 0.06  # straight ahead


def test_a_placement_can_be_saved_and_loaded(refused):
    found = refused[1]
    arrays = {}
    again = decode(encode(found, "placement", arrays), BasePlacement, arrays)
    assert digest(again) == digest(found)
    assert again.best == found.best
    np.testing.assert_array_equal(again.margins, found.margins)


def test_a_head_and_base_moved_together_change_nothing(refused):
    """The same scene with all settings shifted: the same map, suggestions shifted along."""
    path, found = refused
    robot = RobotSettings(base_shift_mm=(300.0, -200.0, 50.0))
    again = place_base(path, RX90, robot, search=SMALL, planner=quick)
    np.testing.assert_array_equal(again.margins, found.margins)
    np.testing.assert_allclose(again.x_mm - 300.0, found.x_mm)
    np.testing.assert_allclose(again.y_mm + 200.0, found.y_mm)
    for a, b in ((again.best, found.best), (again.smallest, found.smallest)):
        np.testing.assert_allclose(np.subtract(a.shift_mm, robot.base_shift_mm), b.shift_mm)
        assert (a.turn_deg, a.moved_mm, a.n_feasible) == (b.turn_deg, b.moved_mm, b.n_feasible)


@pytest.mark.slow
def test_a_mirrored_path_has_a_mirrored_map():
    """Left and right of the arm are alike, but for the rolls that happen to be looked at."""
    path = short("S3")
    mirror = np.array((1.0, -1.0, 1.0))
    other = Path5D(path.points_base * mirror, path.axes_base * mirror)
    none = replace(SMALL, rolls_deg=around(90), half_x_mm=100.0)
    refuse = lambda path, old_in_new: plan_scan(path, RX90, PlanSettings(n_rolls=1))  # noqa: E731
    a = place_base(path, RX90, RobotSettings(), search=none, planner=refuse)
    b = place_base(other, RX90, RobotSettings(), search=none, planner=refuse)
    np.testing.assert_allclose(a.margins, b.margins[:, ::-1], atol=0.15)
    np.testing.assert_allclose(a.turns_deg, -b.turns_deg[:, ::-1], atol=0.11)


@pytest.mark.slow
def test_what_stands_around_moves_with_the_planner(refused):
    """The planner is told how the old base looks from the new place."""
    path, found = refused
    heard = []

    def planner(seen, old_in_new):
        heard.append(old_in_new)
        np.testing.assert_allclose(seen.points_base, old_in_new @ path.points_base, atol=1e-9)
        return quick(seen, old_in_new)

    again = place_base(path, RX90, RobotSettings(), search=SMALL, planner=planner)
    assert again.smallest == found.smallest
    np.testing.assert_allclose(heard[0].matrix(), np.eye(4), atol=1e-12)
    assert len(heard) >= 3


def test_where_nothing_works_the_reasons_say_so():
    far = path_from(short("S0"), Pose.from_translation((2500.0, 0.0, 0.0)))
    tiny = replace(SMALL, half_x_mm=100.0, half_y_mm=100.0, rolls_deg=around(8))
    found = place_base(far, RX90, RobotSettings(), search=tiny, planner=quick)
    assert found.best is None
    assert found.smallest is None
    assert not ((found.margins >= 0.0) & ~found.blocked).any()
    assert not found.verified.any()
    assert any("no place was found" in reason for reason in found.reasons)
    assert any("outside the reach" in reason for reason in found.reasons)


def test_the_head_itself_is_no_place_and_levels_are_tried():
    near = replace(
        SMALL, half_x_mm=400.0, step_mm=200.0, levels_mm=(-150.0, 0.0), rolls_deg=around(8)
    )
    found = place_base(short("S0"), RX90, RobotSettings(), search=near, planner=quick)
    head = short("S0").points_base.mean(axis=0)
    gaps = np.hypot(found.x_mm[:, None] - head[0], found.y_mm[None] - head[1])
    np.testing.assert_array_equal(found.blocked, gaps < 350.0)
    assert set(np.unique(found.levels_mm)) <= {-150.0, 0.0}


def test_cancel_and_progress():
    heard = []
    path = short("S3")
    few = replace(SMALL, half_x_mm=100.0, half_y_mm=0.0)
    place_base(path, RX90, RobotSettings(), search=few, planner=quick, progress=heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0
    with pytest.raises(CancelledError, match="place of the base"):
        place_base(path, RX90, RobotSettings(), search=SMALL, cancel=lambda: True)


def test_nonsense_is_refused_by_name():
    for wrong in ({"step_mm": 1.0}, {"levels_mm": ()}, {"rolls_deg": ()}, {"half_x_mm": -1.0}):
        with pytest.raises(InvalidInputError, match=next(iter(wrong))):
            BaseSearch(**wrong)
    point = Path5D(np.zeros((1, 3)), np.array(((0, 0, 1.0),)))
    with pytest.raises(InvalidInputError, match="two different points"):
        place_base(point, RX90, RobotSettings())
