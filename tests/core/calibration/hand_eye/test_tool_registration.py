import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from rona_core.calibration.hand_eye import tool_registration
from rona_core.calibration.hand_eye.tool_registration import register_tool, solve_paper
from rona_core.calibration.tracking_error import EVEN
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from tests.helpers.strategies import noisy, random_pose, random_rotation, seeds, swings

few = settings(max_examples=6, deadline=None)
methods = pytest.mark.parametrize("method", ["joint", "paper"])
REGION_MM = np.array(((0, 0, 0), (40, 0, 0), (-40, 0, 10), (0, 40, -10), (0, -40, 20.0)))


DRAWS = tool_registration.DRAWS


@pytest.fixture(scope="module", autouse=True)
def _few_repetitions():
    """Few repetitions on simulated noise, which alone tell how certain the published method is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tool_registration, "DRAWS", 8)
        patch.setattr(tool_registration, "MIN_DRAWS", 4)
        yield


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


@methods
@given(seed=seeds)
@few
def test_exact_poses_give_the_registration_exactly(seed, method):
    robot, marker, phases, T_base_tracker, T_toolmarker_tip = motion(np.random.default_rng(seed))
    found = register_tool(robot, marker, phases, method=method)
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
    assert found.used.all()


@methods
def test_close_to_the_origin_exact_poses_are_met_to_a_nanometre(method):
    rng = np.random.default_rng(11)
    robot, _, phases, _, T_toolmarker_tip = motion(rng, cone_deg=45.0)
    T_base_tracker = random_pose(rng, 500)
    marker = T_base_tracker.inv() @ robot @ T_toolmarker_tip.inv()
    found = register_tool(robot, marker, phases, method=method)
    np.testing.assert_allclose(found.T_base_tracker.matrix(), T_base_tracker.matrix(), atol=1e-9)
    np.testing.assert_allclose(
        found.T_toolmarker_tip.matrix(), T_toolmarker_tip.matrix(), atol=1e-9
    )


@pytest.mark.parametrize(("method", "atol"), [("joint", 1e-6), ("paper", 1e-4)])
@given(seed=seeds)
@few
def test_moving_base_or_tracker_moves_only_the_registration(seed, method, atol):
    rng = np.random.default_rng(seed)
    robot, marker, phases, _, _ = motion(rng)
    marker = noisy(rng, marker, 0.05, 0.05)
    T_room_base, T_room_tracker = random_pose(rng, 500), random_pose(rng, 500)
    how = {"method": method, "noise": EVEN}
    found = register_tool(robot, marker, phases, **how)
    moved = register_tool(T_room_base @ robot, T_room_tracker @ marker, phases, **how)
    expected = T_room_base @ found.T_base_tracker @ T_room_tracker.inv()
    np.testing.assert_allclose(moved.T_base_tracker.matrix(), expected.matrix(), atol=atol)
    np.testing.assert_allclose(
        moved.T_toolmarker_tip.matrix(), found.T_toolmarker_tip.matrix(), atol=atol
    )
    np.testing.assert_allclose(moved.residuals_mm, found.residuals_mm, atol=atol)


@methods
@given(seed=seeds)
@few
def test_the_order_of_poses_does_not_matter(seed, method):
    rng = np.random.default_rng(seed)
    robot, marker, phases, _, _ = motion(rng, back_and_forth=True)
    marker = noisy(rng, marker, 0.05, 0.05)
    order = rng.permutation(len(phases))
    found = register_tool(robot, marker, phases, method=method)
    other = register_tool(robot.select(order), marker.select(order), phases[order], method=method)
    np.testing.assert_allclose(
        other.T_base_tracker.matrix(), found.T_base_tracker.matrix(), atol=1e-5
    )
    np.testing.assert_allclose(other.residuals_mm, found.residuals_mm[order], atol=1e-5)


@pytest.mark.slow
def test_noisy_poses_register_the_workpiece_and_the_joint_solve_is_better():
    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        robot, marker, phases, T_base_tracker, _ = motion(rng)
        seen = noisy(rng, marker, 0.03, 0.03)
        place = robot.translations[0] + REGION_MM
        both = []
        for fit in (register_tool(robot, seen), solve_paper(robot, seen, phases)):
            mapped = fit.T_base_tracker @ (T_base_tracker.inv() @ place)
            both.append(np.sqrt(((mapped - place) ** 2).sum(axis=1).mean()))
        errors.append(both)
    joint, paper = np.array(errors).T
    assert np.median(paper) < 0.35
    assert np.max(paper) < 1.2
    assert np.median(joint) < 0.7 * np.median(paper)
    assert np.max(joint) < 0.15


@pytest.mark.sweep(1)
@methods
def test_the_predicted_error_is_the_size_of_the_error(method, monkeypatch):
    monkeypatch.setattr(tool_registration, "DRAWS", DRAWS)
    ratios = []
    for seed in range(25 if method == "joint" else 10):
        rng = np.random.default_rng(seed)
        robot, marker, phases, _, T_toolmarker_tip = motion(rng, spin_deg=20.0)
        found = register_tool(
            robot, noisy(rng, marker, 0.1, 0.1), phases, method=method, noise=EVEN
        )
        off = found.T_toolmarker_tip.translation - T_toolmarker_tip.translation
        ratios.append(np.linalg.norm(off) / found.tip_sigma_mm)
        assert found.tip_sigma_mm == pytest.approx(np.sqrt(np.trace(found.covariance[9:, 9:])))
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_the_verdict_names_what_is_weak_and_what_to_do():
    rng = np.random.default_rng(3)
    robot, marker, phases, T_base_tracker, T_toolmarker_tip = motion(rng)
    good = register_tool(robot, noisy(rng, marker, 0.02, 0.02), phases)
    assert (good.verdict, good.reasons) == ("good", ())
    narrow = motion(rng, cone_deg=6.0, spin_deg=3.0)[0]
    seen = T_base_tracker.inv() @ narrow @ T_toolmarker_tip.inv()
    weak = register_tool(narrow, noisy(rng, seen, 0.02, 0.02), phases)
    assert weak.verdict == "weak"
    assert any("wider cone" in reason for reason in weak.reasons)
    bad = register_tool(narrow, noisy(rng, seen, 0.5, 0.5), phases)
    assert bad.verdict == "bad"
    assert any("off by" in reason for reason in bad.reasons)
    jumpy = marker.translations.copy()
    jumpy[::6] += (20.0, -10.0, 15.0)
    gross = register_tool(robot, noisy(rng, Poses(marker.rotations, jumpy), 0.02, 0.02), phases)
    assert gross.verdict == "weak"
    np.testing.assert_array_equal(np.flatnonzero(~gross.used), np.arange(0, 50, 6))
    assert any("9 of 50 poses were gross errors" in reason for reason in gross.reasons)


def test_the_joint_method_needs_no_phases():
    rng = np.random.default_rng(5)
    n = 20
    robot = Poses(random_rotation(rng) @ swings(rng, n, 30.0), rng.uniform(-100, 100, (n, 3)))
    T_base_tracker, T_toolmarker_tip = random_pose(rng, 2000), random_pose(rng, 200)
    found = register_tool(robot, T_base_tracker.inv() @ robot @ T_toolmarker_tip.inv())
    np.testing.assert_allclose(found.T_base_tracker.matrix(), T_base_tracker.matrix(), atol=1e-8)
    assert found.pivot_rmse_mm is None
    assert found.axes_angle_deg is None
    assert found.line_rmse_mm is None
    assert found.travel_mm == (0.0, 0.0)


def test_the_residuals_are_those_of_the_tip():
    rng = np.random.default_rng(4)
    robot, marker, phases, _, _ = motion(rng)
    marker = noisy(rng, marker, 0.1, 0.1)
    found = register_tool(robot, marker, phases, method="paper")
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
        seen = T_base_tracker.inv() @ robot @ T_toolmarker_tip.inv()
        return register_tool(robot, seen, phases, method="paper")

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
        register_tool(robot, Poses(marker.rotations, slanted), phases, method="paper")


def test_input_that_does_not_fit_together_is_refused():
    robot, marker, phases, _, _ = motion(np.random.default_rng(1))
    with pytest.raises(InvalidInputError, match="as many"):
        register_tool(robot, marker.select(slice(0, 49)), phases)
    with pytest.raises(InvalidInputError, match="as many"):
        register_tool(robot, marker, phases[:-1])
    with pytest.raises(InvalidInputError, match="phases must be"):
        register_tool(robot, marker, np.where(phases == 2, 3, phases))
    with pytest.raises(InvalidInputError, match="phase 2"):
        register_tool(robot, marker, np.where(phases == 2, 1, phases), method="paper")
    with pytest.raises(InvalidInputError, match="needs to know the phase"):
        register_tool(robot, marker, method="paper")
    with pytest.raises(InvalidInputError, match="method"):
        register_tool(robot, marker, phases, method="magic")
