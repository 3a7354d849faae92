import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks.reference.paired_point_registration import _fit, pose_covariance, register_fiducials
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.geometry.pose_covariance import deviate, deviation_between
from rona_core.geometry.rigid_fit import register_points
from tests.helpers.strategies import random_pose, random_rotation, seeds

few = settings(max_examples=20, deadline=None)
FIDUCIALS = np.array(((0, 0, 0), (90, 10, 0), (30, 70, 20), (-40, 50, -30.0), (10, -60, 40)))
TARGETS = np.array(((0, 0, 0), (100, 0, 0), (0, -80, 150), (20, 30, 10.0)))


def random_covariances(rng, n, size_mm=0.3):
    axes = Rotation.random(n, rng=rng).as_matrix()
    variances = (size_mm * rng.uniform(0.3, 1.5, (n, 1, 3))) ** 2
    return axes * variances @ np.swapaxes(axes, 1, 2)


def fitzpatrick_tre_mm(points, targets, fle_mm):
    """The closed formula for even errors: distances from the principal axes of the fiducials."""
    q = points - points.mean(axis=0)
    axes = np.linalg.svd(q)[2]
    d = (targets - points.mean(axis=0)) @ axes.T
    f = q @ axes.T
    total = np.zeros(len(targets))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        total += (d[:, i] ** 2 + d[:, j] ** 2) / (f[:, i] ** 2 + f[:, j] ** 2).mean()
    return np.sqrt(fle_mm**2 / len(points) * (1 + total / 3))


@given(seed=seeds)
@few
def test_moving_both_frames_moves_the_pose_and_leaves_every_error(seed):
    rng = np.random.default_rng(seed)
    points_b = random_pose(rng) @ FIDUCIALS + rng.normal(0, 0.3, FIDUCIALS.shape)
    errors = random_covariances(rng, len(FIDUCIALS))
    T_c_a, T_d_b = random_pose(rng), random_pose(rng)
    turned = T_d_b.rotation @ errors @ T_d_b.rotation.T
    for given_errors, moved_errors in ((None, None), (errors, turned)):
        found = register_fiducials(FIDUCIALS, points_b, covariances=given_errors)
        moved = register_fiducials(T_c_a @ FIDUCIALS, T_d_b @ points_b, covariances=moved_errors)
        expected = T_d_b @ found.T_b_a @ T_c_a.inv()
        np.testing.assert_allclose(moved.T_b_a.matrix(), expected.matrix(), atol=1e-7)
        np.testing.assert_allclose(moved.residuals_mm, found.residuals_mm, atol=1e-7)
        np.testing.assert_allclose(moved.leave_one_out_mm, found.leave_one_out_mm, atol=1e-7)
        np.testing.assert_allclose(
            moved.target_errors_mm(T_c_a @ TARGETS), found.target_errors_mm(TARGETS), rtol=1e-6
        )
        np.testing.assert_allclose(
            moved.target_covariances(T_c_a @ TARGETS),
            T_d_b.rotation @ found.target_covariances(TARGETS) @ T_d_b.rotation.T,
            rtol=1e-5,
            atol=1e-7,
        )


@given(seed=seeds)
@few
def test_even_errors_follow_the_formula_of_fitzpatrick_at_any_origin(seed):
    rng = np.random.default_rng(seed)
    shift = rng.uniform(-2000, 2000, 3)
    points, targets = FIDUCIALS + shift, TARGETS + shift
    points_b = random_pose(rng) @ points + rng.normal(0, 0.2, points.shape)
    found = register_fiducials(points, points_b)
    assert found.fle_mm == pytest.approx(found.fre_mm / np.sqrt(1 - 2 / len(points)))
    np.testing.assert_allclose(
        found.target_errors_mm(targets),
        fitzpatrick_tre_mm(points, targets, found.fle_mm),
        rtol=1e-6,
    )


@pytest.mark.slow
@pytest.mark.parametrize("shift", [(0, 0, 0), (50, -30, -1900.0)])
@pytest.mark.parametrize("case", ["even", "weighted", "anisotropic, fitted as if even"])
def test_predicted_errors_are_those_of_a_simulation(shift, case):
    rng = np.random.default_rng(5)
    n_runs = 1500 if case == "weighted" else 4000
    points, targets = FIDUCIALS + shift, TARGETS + shift
    truth = Pose(random_rotation(rng), rng.uniform(-100, 100, 3))
    errors = random_covariances(rng, len(points)) if case != "even" else None
    spread = np.repeat(0.04 * np.eye(3)[None], len(points), 0) if errors is None else errors
    weighted = case == "weighted"
    exact, roots = truth @ points, np.linalg.cholesky(spread)
    weights = np.linalg.inv(spread) if weighted else None
    squares = np.zeros(len(targets))
    for _ in range(n_runs):
        noise = np.einsum("nij,nj->ni", roots, rng.normal(size=points.shape))
        found = _fit(points, exact + noise, weights)
        squares += ((found @ targets - truth @ targets) ** 2).sum(axis=1)
    simulated = np.sqrt(squares / n_runs)
    covariance = pose_covariance(truth, points, spread, weights)
    found = register_fiducials(points, exact, covariances=spread, weighted=weighted)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-6, atol=1e-12)
    tolerance = 0.05 if weighted else 0.03
    np.testing.assert_allclose(found.target_errors_mm(targets), simulated, rtol=tolerance)


def test_a_general_minimiser_finds_the_same_weighted_pose():
    rng = np.random.default_rng(6)
    errors = random_covariances(rng, len(FIDUCIALS))
    truth = random_pose(rng, 300)
    points_b = truth @ FIDUCIALS + rng.normal(0, 0.5, FIDUCIALS.shape)
    found = register_fiducials(FIDUCIALS, points_b, covariances=errors)
    whitening = np.linalg.cholesky(np.linalg.inv(errors))

    def whitened(x):
        off = points_b - deviate(truth, x) @ FIDUCIALS
        return np.einsum("nji,nj->ni", whitening, off).ravel()

    best = least_squares(whitened, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    np.testing.assert_allclose(deviation_between(truth, found.T_b_a), best.x, atol=1e-6)
    expected = np.linalg.inv(best.jac.T @ best.jac)
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found.covariance / np.outer(size, size), expected / np.outer(size, size), atol=0.02
    )
    assert found.chi_square == pytest.approx(2 * best.cost / (3 * len(FIDUCIALS) - 6), rel=1e-6)


def test_residuals_are_given_for_every_fiducial_and_a_bad_one_is_seen_and_left_out():
    rng = np.random.default_rng(7)
    fiducials = rng.uniform(-100, 100, (9, 3))
    truth = random_pose(rng, 300)
    points_b = truth @ fiducials + rng.normal(0, 0.1, fiducials.shape)
    points_b[2] += (6.0, 0, 0)
    all_of_them = register_fiducials(fiducials, points_b)
    assert np.argmax(all_of_them.leave_one_out_mm) == 2
    assert all_of_them.leave_one_out_mm[2] == pytest.approx(6.0, abs=0.6)
    exclude = np.arange(9) == 2
    others = register_fiducials(fiducials, points_b, exclude=exclude)
    np.testing.assert_array_equal(others.used, ~exclude)
    by_hand = register_points(fiducials[~exclude], points_b[~exclude]).T_b_a
    np.testing.assert_allclose(others.T_b_a.matrix(), by_hand.matrix(), atol=1e-12)
    off = points_b - by_hand @ fiducials
    np.testing.assert_allclose(others.residuals_b, off, atol=1e-12)
    np.testing.assert_allclose(others.residuals_mm, np.linalg.norm(off, axis=1), atol=1e-12)
    assert others.residuals_mm[2] == pytest.approx(all_of_them.leave_one_out_mm[2])
    assert others.fre_mm < 0.3 < all_of_them.fre_mm


def test_fiducials_that_do_not_determine_a_pose_are_refused():
    line = np.outer(np.arange(4.0), (10.0, 5.0, 0.0))
    with pytest.raises(DegenerateGeometryError, match="one line"):
        register_fiducials(line, line)
    with pytest.raises(DegenerateGeometryError, match="2 fiducials"):
        register_fiducials(FIDUCIALS, FIDUCIALS, exclude=[True, True, True, False, False])
    with pytest.raises(InvalidInputError, match="pairs"):
        register_fiducials(FIDUCIALS, FIDUCIALS[:4])
    with pytest.raises(InvalidInputError, match="shape"):
        register_fiducials(FIDUCIALS, FIDUCIALS, covariances=np.eye(2))
    with pytest.raises(InvalidInputError, match="negative variance"):
        register_fiducials(FIDUCIALS, FIDUCIALS, covariances=-np.eye(3))
    with pytest.raises(InvalidInputError, match="exclude"):
        register_fiducials(FIDUCIALS, FIDUCIALS, exclude=[True])
    three = register_fiducials(FIDUCIALS[:3], FIDUCIALS[:3])
    assert three.leave_one_out_mm.size == 0
