import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from rona_core.calibration.handheld.pointer import calibrate_pointer
from rona_core.calibration.pivot.maximum_likelihood import (
    CUTOFF,
    _variance,
    estimate_tip,
    tip_conditions,
)
from rona_core.calibration.pivot.pivot_calibration import solve_pivot
from rona_core.calibration.tracking_error import EVEN, MarkerNoise, tracked_from_poses
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from tests.helpers.pivots import GEOMETRY, TIPS, fitted_poses, marker_sweep, pose_sweep, spoiled
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=15, deadline=None)
DEPTH = MarkerNoise(depth_ratio=3.0)
dofs = st.sampled_from([6, 5])


def fit(poses, dof, noise=DEPTH, **options):
    tracked = tracked_from_poses(poses, GEOMETRY[dof], noise, dof=dof)
    return estimate_tip(tracked, dof=dof, keep=everything(tracked), **options)


def everything(tracked):
    return np.ones(len(tracked.Ts_tracker_marker), dtype=bool)


def calibrate(poses, dof=6, noise=DEPTH, **options):
    return calibrate_pointer(
        poses,
        pointer="p",
        dof=dof,
        method="ml",
        positions_pointermarker=GEOMETRY[dof],
        noise=noise,
        **options,
    )


def errors_of(trials, dof=6, noise=DEPTH, spoil=None, **options):
    """Return errors (t, 3), covariances (t, 3, 3) of the tip over many sweeps."""
    errors, covariances = [], []
    for seed in range(trials):
        rng = np.random.default_rng((seed, dof))
        poses = pose_sweep(rng, dof, noise, **options)
        found = calibrate(poses if spoil is None else spoil(rng, poses), dof, noise)
        errors.append(found.tip_pointermarker - TIPS[dof])
        covariances.append(found.tip_covariance_pointermarker)
    return np.array(errors), np.array(covariances)


def rms(errors):
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


# -- laws ------------------------------------------------------------------------------------------


@given(seed=seeds, dof=dofs)
@few
def test_moving_the_tracker_moves_the_pivot_only_if_all_directions_are_alike(seed, dof):
    rng = np.random.default_rng(seed)
    poses = pose_sweep(rng, dof, EVEN, n=40)
    T_room_tracker = random_pose(rng)
    one, other = calibrate(poses, dof, EVEN), calibrate(T_room_tracker @ poses, dof, EVEN)
    np.testing.assert_allclose(other.tip_pointermarker, one.tip_pointermarker, atol=1e-6)
    np.testing.assert_allclose(other.pivot_tracker, T_room_tracker @ one.pivot_tracker, atol=1e-6)
    np.testing.assert_allclose(
        other.tip_covariance_pointermarker, one.tip_covariance_pointermarker, rtol=1e-5, atol=1e-9
    )


@given(seed=seeds)
@few
def test_another_marker_frame_gives_the_same_tip_in_that_frame(seed):
    rng = np.random.default_rng(seed)
    poses = pose_sweep(rng, 6, DEPTH, n=40)
    T_marker_other = random_pose(rng, reach_mm=100.0)
    T_other_marker = T_marker_other.inv()
    one = fit(poses, 6)
    tracked = tracked_from_poses(poses @ T_marker_other, T_other_marker @ GEOMETRY[6], DEPTH, dof=6)
    other = estimate_tip(tracked, dof=6, keep=everything(tracked))
    np.testing.assert_allclose(other.tip_marker, T_other_marker @ one.tip_marker, atol=1e-6)
    np.testing.assert_allclose(other.pivot_tracker, one.pivot_tracker, atol=1e-6)
    turn = T_other_marker.rotation
    np.testing.assert_allclose(
        other.covariance[:3, :3], turn @ one.covariance[:3, :3] @ turn.T, rtol=1e-5, atol=1e-9
    )


@given(seed=seeds, dof=dofs)
@few
def test_the_order_of_the_poses_does_not_move_the_tip(seed, dof):
    rng = np.random.default_rng(seed)
    poses = pose_sweep(rng, dof, DEPTH, n=50)
    shuffled = poses.select(rng.permutation(50))
    np.testing.assert_allclose(fit(shuffled, dof).tip_marker, fit(poses, dof).tip_marker, atol=1e-6)


@given(seed=seeds, dof=dofs, cone=st.sampled_from([8.0, 25.0, 50.0]))
@few
def test_exact_markers_give_the_tip_exactly(seed, dof, cone):
    rng = np.random.default_rng(seed)
    markers, pivot = marker_sweep(rng, dof, n=30, cone_deg=cone, sigma_mm=0.0)
    found = solve_pivot(
        fitted_poses(markers, dof),
        dof=dof,
        method="ml",
        at_least=10,
        positions_marker=GEOMETRY[dof],
    )
    np.testing.assert_allclose(found.tip_marker, TIPS[dof], atol=1e-8)
    np.testing.assert_allclose(found.pivot_tracker, pivot, atol=1e-8)
    assert found.used.sum() == 30


# -- oracles ---------------------------------------------------------------------------------------


def all_at_once(tracked, start_tip, start_pivot, dof):
    """Minimise over tip, pivot and every rotation together, with a library's solver."""
    n = len(tracked.covariances)
    R, p = tracked.Ts_tracker_marker.rotations, tracked.centers_tracker()
    roots = np.linalg.cholesky(np.linalg.inv(tracked.covariances + 1e-12 * np.eye(6)))

    def residuals(x):
        turns = x[6:].reshape(n, 3)
        true = Rotation.from_rotvec(-turns).as_matrix() @ R
        tip = x[:3] if dof == 6 else np.array((0.0, 0.0, x[2]))
        shifts = p - x[3:6] + true @ (tip - tracked.reference_marker)
        errors = np.concatenate((turns, shifts), axis=1)
        return np.einsum("nji,nj->ni", roots, errors).ravel()

    start = np.concatenate((start_tip, start_pivot, np.zeros(3 * n)))
    scale = np.concatenate((np.ones(6), np.full(3 * n, 1e-2)))
    return least_squares(residuals, start, x_scale=scale, xtol=1e-14, ftol=1e-14, gtol=1e-12).x


def test_eliminating_the_poses_gives_the_optimum_over_all_parameters():
    poses = pose_sweep(np.random.default_rng(4), 6, DEPTH, n=12)
    tracked = tracked_from_poses(poses, GEOMETRY[6], DEPTH, dof=6)
    found = estimate_tip(tracked, dof=6, keep=everything(tracked), cutoff=np.inf)
    x = all_at_once(tracked, TIPS[6], found.pivot_tracker + 1.0, 6)
    np.testing.assert_allclose(found.tip_marker, x[:3], atol=2e-5)
    np.testing.assert_allclose(found.pivot_tracker, x[3:6], atol=2e-5)


@pytest.mark.parametrize("dof", [6, 5])
def test_the_covariance_of_a_pose_is_that_of_many_fits(dof):
    rng = np.random.default_rng(3)
    truth = Pose.from_rotvec((0.3, -0.8, 0.4), (50.0, -80.0, 1900.0))
    noise = MarkerNoise(depth_ratio=3.0, sigma_mm=0.35)
    clean = truth @ GEOMETRY[dof]
    white = rng.normal(size=(4000, *clean.shape)) * noise.shape() * noise.sigma_mm
    poses = fitted_poses(clean + white, dof)
    stated = tracked_from_poses(Poses.stack([truth]), GEOMETRY[dof], noise, dof=dof)
    R = poses.rotations @ truth.rotation.T
    turns = Rotation.from_matrix(R).as_rotvec()
    if dof == 5:
        z = truth.rotation[:, 2]
        turns = np.cross(z, poses.rotations[:, :, 2] - z)
    shifts = poses @ stated.reference_marker - truth @ stated.reference_marker
    errors = np.concatenate((turns, shifts), axis=1)
    expected = stated.covariances[0] * noise.sigma_mm**2
    scale = np.sqrt(np.maximum(np.diag(expected), 1e-12))
    apart = (np.cov(errors.T) - expected) / np.outer(scale, scale)
    assert np.abs(apart).max() < 0.1


# -- statistics ------------------------------------------------------------------------------------


def nees_of(trials, dof):
    """Return squared errors (t,) in units of the stated ones, and how many coordinates count."""
    errors, covariances = errors_of(trials, dof)
    kept = slice(None) if dof == 6 else slice(2, 3)
    e, c = errors[:, kept], covariances[:, kept, kept]
    if dof == 5:
        np.testing.assert_array_equal(errors[:, :2], 0.0)
        np.testing.assert_array_equal(covariances[:, :2], 0.0)
    return np.einsum("ni,nij,nj->n", e, np.linalg.inv(c), e), e.shape[1]


@pytest.mark.parametrize("dof", [6, 5])
def test_the_predicted_covariance_is_of_the_size_of_the_errors(dof):
    nees, k = nees_of(20, dof)
    assert 0.5 < nees.mean() / k < 1.7


@pytest.mark.slow
@pytest.mark.parametrize("dof", [6, 5])
def test_the_predicted_covariance_is_honest(dof):
    nees, k = nees_of(150, dof)
    assert 0.75 < nees.mean() / k < 1.35
    assert 0.9 <= (nees < chi2.ppf(0.95, k)).mean() <= 0.99


@pytest.mark.slow
def test_depth_noise_is_worth_knowing():
    weighted, even = errors_of(60)[0], []
    for seed in range(60):
        poses = pose_sweep(np.random.default_rng((seed, 6)), 6, DEPTH)
        even.append(calibrate(poses, 6, EVEN).tip_pointermarker - TIPS[6])
    assert rms(weighted) < 0.92 * rms(np.array(even))


def errors_of_methods(methods, trials, **options):
    """Return the errors (t, 3) of several methods on the same poses."""
    errors = {method: [] for method in methods}
    for seed in range(trials):
        poses = pose_sweep(np.random.default_rng((seed, 1)), 6, EVEN, **options)
        for method, found in errors.items():
            result = calibrate_pointer(
                poses,
                pointer="p",
                dof=6,
                method=method,
                positions_pointermarker=GEOMETRY[6],
                noise=EVEN,
            )
            found.append(result.tip_pointermarker - TIPS[6])
    return [np.array(found) for found in errors.values()]


def test_it_beats_the_sphere_on_the_same_poses():
    likely, sphere = errors_of_methods(("ml", "sphere"), 10, cone_deg=15.0)
    assert 2.0 * rms(likely) < rms(sphere)


@pytest.mark.parametrize(
    ("kind", "trials"),
    [("gross", 8), ("slip", 8)]
    + [
        pytest.param(kind, 40, marks=pytest.mark.slow)
        for kind in ("gross", "slip", "slipped for a while")
    ],
)
def test_outliers_cost_next_to_nothing(kind, trials):
    clean, _ = errors_of(trials, 6, EVEN)
    errors, covariances = errors_of(trials, 6, EVEN, spoil=lambda rng, p: spoiled(rng, p, kind))
    assert rms(errors) < 1.25 * rms(clean)
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
    assert 0.6 < nees.mean() / 3 < 1.5


@given(seed=seeds)
@few
def test_gross_errors_are_named_and_do_not_count(seed):
    rng = np.random.default_rng(seed)
    poses = pose_sweep(rng, 6, DEPTH)
    wrong = spoiled(rng, poses, "gross")
    moved = np.flatnonzero((wrong.translations != poses.translations).any(axis=1))
    found = calibrate(wrong)
    assert not found.used[moved].any()
    named = {r.index for r in found.rejected}
    assert named == set(np.flatnonzero(~found.used))
    assert all(r.reason == "away from the common tip" for r in found.rejected)
    assert all(r.residual_mm == found.residuals_mm[r.index] for r in found.rejected)


# -- choices ---------------------------------------------------------------------------------------


def test_an_excluded_pose_does_not_count_but_is_listed():
    rng = np.random.default_rng(2)
    poses = pose_sweep(rng, 6, DEPTH)
    exclude = np.zeros(100, dtype=bool)
    exclude[[3, 70]] = True
    found = calibrate(poses, exclude=exclude)
    without = calibrate(poses.select(~exclude))
    np.testing.assert_allclose(found.tip_pointermarker, without.tip_pointermarker, atol=1e-6)
    by_hand = [r.index for r in found.rejected if r.reason == "excluded by hand"]
    assert by_hand == [3, 70]
    assert found.residuals_mm.shape == (100,)
    with pytest.raises(InvalidInputError, match="exclude"):
        calibrate(poses, exclude=np.zeros(99, dtype=bool))
    with pytest.raises(InvalidInputError, match="at least 10"):
        calibrate(poses, exclude=np.arange(100) >= 9)


def test_what_cannot_be_solved_is_refused_by_name():
    poses = pose_sweep(np.random.default_rng(2), 6, DEPTH)
    with pytest.raises(InvalidInputError, match="marker geometry"):
        calibrate_pointer(poses, pointer="p", dof=6, method="ml")
    line, lines = GEOMETRY[5], pose_sweep(np.random.default_rng(2), 5, DEPTH)
    with pytest.raises(DegenerateGeometryError, match="no 6D tool"):
        calibrate_pointer(poses, pointer="p", dof=6, positions_pointermarker=line)
    with pytest.raises(InvalidInputError, match="z axis"):
        calibrate_pointer(lines, pointer="p", dof=5, positions_pointermarker=line[:, ::-1])
    half = np.arange(100) % 2 == 0
    shift = np.where(half[:, None], (0.0, 0.0, 0.0), (30.0, 0.0, 0.0))
    with pytest.raises(DegenerateGeometryError, match="share no tip"):
        calibrate(Poses(poses.rotations, poses.translations + shift))


@pytest.mark.slow
def test_of_few_poses_the_stated_error_is_still_that_of_the_tip():
    """Twelve poses, six unknowns: the freedom that is lost counts."""
    errors, covariances = errors_of(150, 6, EVEN, n=12, cone_deg=30.0)
    stated = np.sqrt(np.trace(covariances, axis1=1, axis2=2).mean())
    assert stated == pytest.approx(rms(errors), rel=0.2)


# -- formulas, term by term ------------------------------------------------------------------------


@pytest.mark.parametrize("dof", [6, 5])
def test_a_misclosure_has_the_covariance_that_all_six_errors_of_a_pose_give_it(dof):
    """B Q B' in one product, with errors of place and turn that hang together strongly."""
    rng = np.random.default_rng(5)
    roots = rng.normal(size=(7, 6, 6))
    Q = roots @ np.swapaxes(roots, 1, 2)
    poses = pose_sweep(rng, dof, DEPTH).select(np.arange(7))
    tracked = replace(tracked_from_poses(poses, GEOMETRY[dof], DEPTH, dof=dof), covariances=Q)
    found = tip_conditions(tracked, TIPS[dof], dof=dof)
    lever = tracked.Ts_tracker_marker.rotations @ (TIPS[dof] - tracked.reference_marker)
    B = np.concatenate(
        (np.cross(np.eye(3), lever[:, None]), np.broadcast_to(-np.eye(3), (7, 3, 3))), axis=2
    )
    N = B @ Q @ np.swapaxes(B, 1, 2)
    np.testing.assert_allclose(N @ found.N_inv_A, found.A, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("cutoff", [CUTOFF, 7.0])
def test_the_robust_variance_of_normal_errors_is_theirs(cutoff):
    places = (np.arange(200_001) + 0.5) / 200_001
    costs = 1.7 * chi2.ppf(places, 3)
    assert _variance(costs, 1.7, cutoff, 0) == pytest.approx(1.7, rel=2e-4)
    few_costs = costs[::20_000]  # 11 poses: 33 freedoms, less the unknowns
    assert _variance(few_costs, 1.7, cutoff, 6) == pytest.approx(
        _variance(few_costs, 1.7, cutoff, 0) * 33.0 / 27.0
    )


def test_a_tip_that_scatters_by_more_than_5_mm_is_none():
    """Poses in pairs with the same turn, the tip to both sides of the pivot alike."""
    once = pose_sweep(np.random.default_rng(8), 6, DEPTH).rotations
    R = np.repeat(once, 2, axis=0)
    side = np.tile((1.0, -1.0), len(once))[:, None] * np.array((1.0, 0.0, 0.0))

    def solved(size_mm):
        poses = Poses(R, size_mm * side - R @ TIPS[6])
        return solve_pivot(poses, dof=6, method="sphere", at_least=10)

    taken, refused = [], []
    low_mm, high_mm = 2.0, 6.0
    for _ in range(7):
        middle_mm = (low_mm + high_mm) / 2.0
        try:
            taken.append(solved(middle_mm).rmse_mm)
            low_mm = middle_mm
        except DegenerateGeometryError as error:
            high_mm = middle_mm
            refused.append(float(re.search(r"scatters by ([\d.]+) mm", str(error))[1]))
    assert 4.8 < max(taken) <= 5.0
    assert 4.95 < min(refused) < 5.2
