import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from rona_core.calibration.tool import register_tool
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from tests.core.strategies import noisy, random_pose, random_rotation, seeds, swings

few = settings(max_examples=20, deadline=None)
REGION_MM = np.array(((0, 0, 0), (40, 0, 0), (-40, 0, 10), (0, 40, -10), (0, -40, 20.0)))


def motion(
    rng, *, n=(30, 10, 10), cone_deg=20.0, travel_mm=100.0, spin_deg=40.0, back_and_forth=False
):
    """Return true robot poses, marker poses, phases, T_base_tracker and T_toolmarker_tip."""
    start = Pose(random_rotation(rng), rng.uniform(-900, 900, 3))
    rotations = [start.rotation @ swings(rng, n[0], cone_deg, spin_deg=spin_deg)]
    positions = [np.repeat(start.translation[None], n[0], axis=0)]
    for axis in (0, 1):
        travel = np.linspace(-0.3, 0.7, n[axis + 1]) * travel_mm
        if back_and_forth:
            travel = rng.permutation(travel)
        rotations.append(np.repeat(start.rotation[None], len(travel), axis=0))
        positions.append(start.translation + np.outer(travel, start.rotation[:, axis]))
    Ts_base_tip = Poses(np.concatenate(rotations), np.concatenate(positions))
    T_base_tracker = random_pose(rng, 2500)
    T_toolmarker_tip = Pose(random_rotation(rng), np.array((5.0, -150.0, -40.0)))
    Ts_tracker_toolmarker = T_base_tracker.inv() @ Ts_base_tip @ T_toolmarker_tip.inv()
    phases = np.repeat((0, 1, 2), n)
    return Ts_base_tip, Ts_tracker_toolmarker, phases, T_base_tracker, T_toolmarker_tip


@given(seed=seeds)
@few
def test_exact_poses_give_the_registration_exactly(seed):
    robot, marker, phases, T_base_tracker, T_toolmarker_tip = motion(np.random.default_rng(seed))
    found = register_tool(robot, marker, phases)
    np.testing.assert_allclose(found.T_base_tracker.rotation, T_base_tracker.rotation, atol=1e-9)
    np.testing.assert_allclose(
        found.T_toolmarker_tip.matrix(), T_toolmarker_tip.matrix(), atol=1e-7
    )
    np.testing.assert_allclose(found.residuals_mm, 0.0, atol=1e-7)
    tip = robot.translations[0]
    mapped = found.T_base_tracker @ (T_base_tracker.inv() @ (tip + REGION_MM))
    np.testing.assert_allclose(mapped, tip + REGION_MM, atol=1e-6)
    assert found.axes_angle_deg == pytest.approx(90.0, abs=1e-6)
    assert found.travel_mm == pytest.approx((100.0, 100.0))
    assert found.n_poses == 50
    assert max(found.pivot_rmse_mm, found.line_rmse_mm, found.rmse_mm) < 1e-7


def test_close_to_the_origin_exact_poses_are_met_to_a_nanometre():
    rng = np.random.default_rng(11)
    robot, _, phases, _, T_toolmarker_tip = motion(rng, cone_deg=45.0)
    T_base_tracker = random_pose(rng, 500)
    marker = T_base_tracker.inv() @ robot @ T_toolmarker_tip.inv()
    found = register_tool(robot, marker, phases)
    np.testing.assert_allclose(found.T_base_tracker.matrix(), T_base_tracker.matrix(), atol=1e-9)
    np.testing.assert_allclose(
        found.T_toolmarker_tip.matrix(), T_toolmarker_tip.matrix(), atol=1e-9
    )


@given(seed=seeds)
@few
def test_moving_base_or_tracker_moves_only_the_registration(seed):
    rng = np.random.default_rng(seed)
    robot, marker, phases, _, _ = motion(rng)
    marker = noisy(rng, marker, 0.05, 0.05)
    T_room_base, T_room_tracker = random_pose(rng, 500), random_pose(rng, 500)
    found = register_tool(robot, marker, phases)
    moved = register_tool(T_room_base @ robot, T_room_tracker @ marker, phases)
    expected = T_room_base @ found.T_base_tracker @ T_room_tracker.inv()
    np.testing.assert_allclose(moved.T_base_tracker.matrix(), expected.matrix(), atol=1e-4)
    np.testing.assert_allclose(
        moved.T_toolmarker_tip.matrix(), found.T_toolmarker_tip.matrix(), atol=1e-4
    )
    np.testing.assert_allclose(moved.residuals_mm, found.residuals_mm, atol=1e-4)


@given(seed=seeds)
@few
def test_the_order_of_poses_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    robot, marker, phases, _, _ = motion(rng, back_and_forth=True)
    marker = noisy(rng, marker, 0.05, 0.05)
    order = rng.permutation(len(phases))
    found = register_tool(robot, marker, phases)
    other = register_tool(robot.select(order), marker.select(order), phases[order])
    np.testing.assert_allclose(
        other.T_base_tracker.matrix(), found.T_base_tracker.matrix(), atol=1e-5
    )
    np.testing.assert_allclose(other.residuals_mm, found.residuals_mm[order], atol=1e-5)


def test_noisy_poses_register_the_workpiece_to_half_a_millimetre():
    errors = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        robot, marker, phases, T_base_tracker, _ = motion(rng)
        found = register_tool(robot, noisy(rng, marker, 0.03, 0.03), phases)
        place = robot.translations[0] + REGION_MM
        mapped = found.T_base_tracker @ (T_base_tracker.inv() @ place)
        errors.append(np.sqrt(((mapped - place) ** 2).sum(axis=1).mean()))
    assert np.median(errors) < 0.35
    assert np.max(errors) < 1.2


def test_the_residuals_are_those_of_the_tip():
    rng = np.random.default_rng(4)
    robot, marker, phases, _, _ = motion(rng)
    marker = noisy(rng, marker, 0.1, 0.1)
    found = register_tool(robot, marker, phases)
    tips = found.T_base_tracker @ (marker @ found.T_toolmarker_tip.translation)
    np.testing.assert_allclose(
        found.residuals_mm, np.linalg.norm(tips - robot.translations, axis=1), atol=1e-9
    )
    assert abs(found.axes_angle_deg - 90.0) < 0.5
    assert 0.01 < found.line_rmse_mm < 0.2


def test_motions_that_leave_something_open_are_refused_by_name():
    rng = np.random.default_rng(1)
    robot, marker, phases, T_base_tracker, T_toolmarker_tip = motion(rng)

    def register(robot, phases=phases):
        return register_tool(robot, T_base_tracker.inv() @ robot @ T_toolmarker_tip.inv(), phases)

    with pytest.raises(DegenerateGeometryError, match="half-angle"):
        register(motion(rng, cone_deg=3.0, spin_deg=0.0)[0])
    with pytest.raises(DegenerateGeometryError, match="moved only"):
        register(motion(rng, travel_mm=5.0)[0])
    with pytest.raises(DegenerateGeometryError, match="off that tool axis"):
        register(robot, np.repeat((0, 2, 1), (30, 10, 10)))
    turning = robot.rotations.copy()
    turning[30:40] = (
        turning[30:40]
        @ Rotation.from_rotvec(np.outer(np.linspace(0, 0.2, 10), (0, 0, 1))).as_matrix()
    )
    with pytest.raises(DegenerateGeometryError, match="turned by"):
        register(Poses(turning, robot.translations))
    slanted = marker.translations.copy()
    slanted[40:] += np.linspace(-30, 30, 10)[:, None] * (
        T_base_tracker.rotation.T @ robot.rotations[30, :, 0]
    )
    with pytest.raises(DegenerateGeometryError, match="apart, not 90"):
        register_tool(robot, Poses(marker.rotations, slanted), phases)


def test_input_that_does_not_fit_together_is_refused():
    robot, marker, phases, _, _ = motion(np.random.default_rng(1))
    with pytest.raises(InvalidInputError, match="as many"):
        register_tool(robot, marker.select(slice(0, 49)), phases)
    with pytest.raises(InvalidInputError, match="as many"):
        register_tool(robot, marker, phases[:-1])
    with pytest.raises(InvalidInputError, match="phases must be"):
        register_tool(robot, marker, np.where(phases == 2, 3, phases))
    with pytest.raises(InvalidInputError, match="phase 2"):
        register_tool(robot, marker, np.where(phases == 2, 1, phases))
    with pytest.raises(InvalidInputError, match="method"):
        register_tool(robot, marker, phases, method="magic")
