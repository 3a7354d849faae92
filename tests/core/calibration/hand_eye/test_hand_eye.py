import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from rona_core.calibration.hand_eye.hand_eye import (
    TOOL_MARKERS,
    first_guess,
    fit_covariances,
    jacobians,
    moved,
    observe,
    residuals,
    robot_covariances,
    solve_hand_eye,
)
from rona_core.calibration.tracking_error import EVEN, MarkerNoise
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import (
    cross_matrices,
    deviate,
    deviation_between,
    point_jacobians,
)
from rona_core.geometry.rigid_fit import register_points
from tests.helpers.strategies import angle_rad, random_pose, random_rotation, seeds

few = settings(max_examples=10, deadline=None)
SIGMA_MM = 0.35
STEREO = MarkerNoise()
REGION_MM = np.array(((0, 0, -10), (60, 0, 20), (-60, 0, 20), (0, 60, 20), (0, -60, 20.0)))


def scene(rng, n=50, *, turn_deg=20.0, travel_mm=50.0):
    """Return exact robot poses, marker poses, T_base_tracker and T_toolmarker_tip."""
    start = Pose(random_rotation(rng), rng.uniform(-600, 600, 3))
    turns = Rotation.from_rotvec(np.deg2rad(rng.uniform(-turn_deg, turn_deg, (n, 3)))).as_matrix()
    shifts = start.translation + rng.uniform(-travel_mm, travel_mm, (n, 3))
    robot = Poses(start.rotation @ turns, shifts)
    T_base_tracker = random_pose(rng, 1500)
    T_toolmarker_tip = Pose(random_rotation(rng), np.array((0.0, -150.0, -40.0)))
    return (
        robot,
        T_base_tracker.inv() @ robot @ T_toolmarker_tip.inv(),
        (
            T_base_tracker,
            T_toolmarker_tip,
        ),
    )


def tracked(rng, poses, sigma_mm=SIGMA_MM, noise=STEREO):
    """Return the poses that a tracker fits to noisy markers."""
    fits = []
    for T_tracker_toolmarker in poses:
        seen = T_tracker_toolmarker @ TOOL_MARKERS
        seen = seen + rng.normal(size=seen.shape) * noise.shape() * sigma_mm
        fits.append(register_points(TOOL_MARKERS, seen).T_b_a)
    return Poses.stack(fits)


def shaky(rng, poses, sigma_mm=0.1, sigma_deg=0.02):
    turns = Rotation.from_rotvec(
        rng.normal(0, np.deg2rad(sigma_deg) / np.sqrt(3), (len(poses), 3))
    ).as_matrix()
    shifts = rng.normal(0, sigma_mm / np.sqrt(3), (len(poses), 3))
    return Poses(turns @ poses.rotations, poses.translations + shifts)


def upset(rng, poses, share):
    """Return poses with gross errors of 5 to 50 mm and 1 to 20 degrees, and which ones they are."""
    rows = rng.permutation(len(poses))[: round(share * len(poses))]
    rotations, translations = poses.rotations.copy(), poses.translations.copy()
    for i in rows:
        axis, way = rng.normal(size=(2, 3))
        turn = np.deg2rad(rng.uniform(1, 20)) * axis / np.linalg.norm(axis)
        rotations[i] = Rotation.from_rotvec(turn).as_matrix() @ rotations[i]
        translations[i] += rng.uniform(5, 50) * way / np.linalg.norm(way)
    return Poses(rotations, translations), np.sort(rows)


def errors(fit, truth):
    return np.concatenate(
        (
            deviation_between(truth[0], fit.T_base_tracker),
            deviation_between(truth[1], fit.T_toolmarker_tip),
        )
    )


# -- laws ------------------------------------------------------------------------------------------


@given(seed=seeds)
@few
def test_exact_poses_are_met_to_a_hundredth_of_a_nanometre(seed):
    rng = np.random.default_rng(seed)
    robot, marker, truth = scene(rng, int(rng.integers(5, 40)))
    fit = solve_hand_eye(robot, marker)
    places = robot.translations[0] + REGION_MM
    mapped = fit.T_base_tracker @ (truth[0].inv() @ places)
    np.testing.assert_allclose(mapped, places, atol=1e-8)
    np.testing.assert_allclose(fit.T_toolmarker_tip.translation, truth[1].translation, atol=1e-8)
    assert fit.used.all()
    assert fit.rejected == ()


@given(seed=seeds)
@few
def test_moving_base_tracker_or_marker_frame_moves_the_answer_with_it(seed):
    rng = np.random.default_rng(seed)
    robot, marker, _ = scene(rng, 20)
    robot, marker = shaky(rng, robot), tracked(rng, marker, noise=EVEN)
    T_a_base, T_b_tracker, T_c_toolmarker = (random_pose(rng, 300) for _ in range(3))
    fit = solve_hand_eye(robot, marker, noise=EVEN)
    moved_fit = solve_hand_eye(
        T_a_base @ robot,
        T_b_tracker @ marker @ T_c_toolmarker.inv(),
        noise=EVEN,
        positions_toolmarker=T_c_toolmarker @ TOOL_MARKERS,
    )
    expected = T_a_base @ fit.T_base_tracker @ T_b_tracker.inv()
    np.testing.assert_allclose(moved_fit.T_base_tracker.matrix(), expected.matrix(), atol=1e-6)
    np.testing.assert_allclose(
        moved_fit.T_toolmarker_tip.matrix(),
        (T_c_toolmarker @ fit.T_toolmarker_tip).matrix(),
        atol=1e-6,
    )
    np.testing.assert_allclose(moved_fit.distances, fit.distances, atol=1e-6)
    # deviations follow: those of T_base_tracker turn with the base, and about the new tracker
    change = np.eye(12)
    change[:3, :3] = change[3:6, 3:6] = T_a_base.rotation
    arm = -T_a_base.rotation @ fit.T_base_tracker.rotation @ T_b_tracker.inv().translation
    change[3:6, :3] = cross_matrices(arm) @ T_a_base.rotation
    change[6:9, 6:9] = change[9:, 9:] = T_c_toolmarker.rotation
    expected = change @ fit.covariance @ change.T
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        moved_fit.covariance / np.outer(size, size), expected / np.outer(size, size), atol=1e-5
    )


@given(seed=seeds)
@few
def test_the_derivatives_are_those_of_the_residuals(seed):
    rng = np.random.default_rng(seed)
    robot, marker, (T_base_tracker, T_toolmarker_tip) = scene(rng, 6)
    marker, _ = upset(rng, marker, 0.5)  # so that the turns left over are not small
    seen = observe(robot, marker, TOOL_MARKERS, STEREO)
    center = robot.translations.mean(axis=0)
    e = residuals(seen, T_base_tracker, T_toolmarker_tip)
    J = jacobians(seen, T_base_tracker, T_toolmarker_tip, e[:, :3], center)
    for k in range(12):
        step = np.zeros(12)
        step[k] = 1e-5
        ahead = residuals(seen, *moved(T_base_tracker, T_toolmarker_tip, step, center))
        behind = residuals(seen, *moved(T_base_tracker, T_toolmarker_tip, -step, center))
        np.testing.assert_allclose(J[:, :, k], (ahead - behind) / 2e-5, atol=2e-5)


# -- oracles ---------------------------------------------------------------------------------------


def test_a_general_minimiser_finds_the_same_place_and_the_same_covariance():
    rng = np.random.default_rng(7)
    robot, marker, truth = scene(rng, 15)
    robot, marker = shaky(rng, robot), tracked(rng, marker)
    fit = solve_hand_eye(robot, marker)
    assert fit.used.sum() >= 14
    seen = observe(robot, marker, TOOL_MARKERS, MarkerNoise())
    covariances = fit.marker_sigma_mm**2 * seen.unit_covariances + robot_covariances(
        seen, fit.T_base_tracker, fit.T_toolmarker_tip
    )
    whitening = np.linalg.inv(np.linalg.cholesky(covariances))
    units = np.tile(np.repeat((1e-3, 1.0), 3), 2)

    def poses(x):
        return deviate(truth[0], x[:6] * units[:6]), deviate(truth[1], x[6:] * units[6:])

    def whitened(x):
        apart = np.einsum("nij,nj->ni", whitening, residuals(seen, *poses(x)))
        return apart[fit.used].ravel()

    found = least_squares(whitened, np.zeros(12), jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    T_base_tracker, T_toolmarker_tip = poses(found.x)
    places = robot.translations[0] + REGION_MM
    np.testing.assert_allclose(
        fit.T_base_tracker @ (truth[0].inv() @ places),
        T_base_tracker @ (truth[0].inv() @ places),
        atol=1e-4,
    )
    np.testing.assert_allclose(fit.T_toolmarker_tip.matrix(), T_toolmarker_tip.matrix(), atol=1e-4)
    expected = np.linalg.inv(found.jac.T @ found.jac) * np.outer(units, units)
    size = np.sqrt(np.diag(expected))
    scale = max(1.0, fit.chi_square)
    np.testing.assert_allclose(
        fit.covariance / np.outer(size, size), scale * expected / np.outer(size, size), atol=2e-3
    )


@pytest.mark.slow
def test_the_covariance_of_a_tracked_pose_is_that_of_many_fits():
    rng = np.random.default_rng(2)
    rotation = random_rotation(rng)
    truth = Pose(rotation, np.array((100.0, -50.0, 1900.0)))
    centroid = TOOL_MARKERS.mean(axis=0)
    seen = tracked(rng, [truth] * 3000)
    turns = Rotation.from_matrix(seen.rotations @ rotation.T).as_rotvec()
    shifts = seen @ centroid - truth @ centroid
    measured = np.cov(np.hstack((turns, shifts)).T)
    expected = SIGMA_MM**2 * fit_covariances(rotation[None], TOOL_MARKERS, STEREO)[0]
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        measured / np.outer(size, size), expected / np.outer(size, size), atol=0.09
    )


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.06])
def test_the_covariance_is_honest(share):
    whole, place, sigmas = [], [], []
    for trial in range(60):
        rng = np.random.default_rng((8, trial))
        robot, marker, truth = scene(rng, 50)
        marker, wrong = upset(rng, tracked(rng, marker), share)
        fit = solve_hand_eye(shaky(rng, robot), marker)
        off = errors(fit, truth)
        whole.append(off @ np.linalg.solve(fit.covariance, off) / 12)
        target_base = robot.translations.mean(axis=0) + REGION_MM[1]
        target_tracker = truth[0].inv() @ target_base
        J = point_jacobians(fit.T_base_tracker, target_tracker[None])[0]
        miss = fit.T_base_tracker @ target_tracker - target_base
        place.append(miss @ np.linalg.solve(J @ fit.covariance[:6, :6] @ J.T, miss) / 3)
        sigmas.append(fit.marker_sigma_mm)
        assert set(wrong) <= set(fit.rejected)
    assert 0.75 < np.mean(whole) < 1.35
    assert 0.75 < np.mean(place) < 1.35
    assert np.mean(sigmas) == pytest.approx(SIGMA_MM, rel=0.05)


def test_a_third_of_gross_errors_is_found():
    for trial in range(5):
        rng = np.random.default_rng((9, trial))
        robot, marker, truth = scene(rng, 60)
        marker, wrong = upset(rng, tracked(rng, marker, 0.05), 0.33)
        fit = solve_hand_eye(shaky(rng, robot), marker)
        assert set(wrong) <= set(fit.rejected)
        assert len(fit.rejected) <= len(wrong) + 1
        assert np.linalg.norm(errors(fit, truth)[9:]) < 0.3


def test_the_first_guess_is_near_the_answer():
    for trial in range(10):
        rng = np.random.default_rng((10, trial))
        robot, marker, truth = scene(rng, 40)
        marker, _ = upset(rng, tracked(rng, marker), 0.2)
        T_base_tracker, T_toolmarker_tip = first_guess(robot, marker)
        assert angle_rad(T_base_tracker, truth[0]) < np.deg2rad(5.0)
        assert np.linalg.norm(T_toolmarker_tip.translation - truth[1].translation) < 30.0


# -- refusals --------------------------------------------------------------------------------------


def test_what_a_motion_leaves_open_is_named():
    rng = np.random.default_rng(3)
    robot, _, (T_base_tracker, T_toolmarker_tip) = scene(rng, 20)

    def solve(robot):
        seen = T_base_tracker.inv() @ robot @ T_toolmarker_tip.inv()
        return solve_hand_eye(robot, tracked(rng, seen, 0.05))

    still = Poses(np.repeat(robot.rotations[:1], 20, axis=0), robot.translations)
    with pytest.raises(DegenerateGeometryError, match=r"did not turn.*any direction"):
        solve(still)
    axis_tip = np.array((0.6, 0.0, 0.8))
    angles = np.deg2rad(rng.uniform(-40, 40, 20))
    hinge = robot.rotations[0] @ Rotation.from_rotvec(np.outer(angles, axis_tip)).as_matrix()
    with pytest.raises(DegenerateGeometryError, match="one axis only") as caught:
        solve(Poses(hinge, robot.translations))
    for direction, frame in (
        (T_toolmarker_tip.rotation @ axis_tip, "toolmarker"),
        (robot.rotations[0] @ axis_tip, "base"),
    ):
        named = str(caught.value).split(f" of {frame}")[0].rsplit("(", 1)[1].strip(")")
        found = np.array([float(x) for x in named.split(",")])
        assert abs(found @ direction) > 0.995 * np.linalg.norm(found)


def test_poses_that_do_not_belong_together_are_refused():
    rng = np.random.default_rng(4)
    robot, marker, _ = scene(rng, 20)
    with pytest.raises(DegenerateGeometryError, match=r"do not agree|poses agree"):
        solve_hand_eye(robot, upset(rng, tracked(rng, marker, 0.02), 0.6)[0])
    with pytest.raises(InvalidInputError, match="at least 4"):
        solve_hand_eye(robot.select(slice(0, 3)), marker.select(slice(0, 3)))
    with pytest.raises(InvalidInputError, match="as many"):
        solve_hand_eye(robot, marker.select(slice(0, 3)))
    line = np.outer(np.arange(3.0), (10.0, 0.0, 0.0))
    with pytest.raises(DegenerateGeometryError, match="one line"):
        solve_hand_eye(robot, marker, positions_toolmarker=line)
