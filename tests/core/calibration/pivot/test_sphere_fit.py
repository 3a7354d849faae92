import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from rona_core.calibration.pivot.motion_extent import fit_sphere
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from tests.helpers.strategies import cap, random_pose, seeds, thin_points

few = settings(max_examples=25, deadline=None)


@given(seed=seeds, half_angle_deg=st.sampled_from([6.0, 20.0, 90.0, 180.0]))
@few
def test_an_exact_sphere_is_recovered(seed, half_angle_deg):
    rng = np.random.default_rng(seed)
    T = random_pose(rng)
    fit = fit_sphere(T @ cap(rng, half_angle_deg=half_angle_deg))
    np.testing.assert_allclose(fit.center, T.translation, atol=2e-7)
    assert fit.radius_mm == pytest.approx(200.0, abs=2e-7)
    assert fit.rms_mm < 1e-9


@given(seed=seeds)
@few
def test_moving_the_points_moves_the_sphere(seed):
    rng = np.random.default_rng(seed)
    points, T = cap(rng) + rng.normal(0, 0.3, (60, 3)), random_pose(rng)
    fit, moved = fit_sphere(points), fit_sphere(T @ points)
    np.testing.assert_allclose(moved.center, T @ fit.center, atol=1e-6)
    assert moved.radius_mm == pytest.approx(fit.radius_mm, abs=1e-6)
    assert moved.cap_deg == pytest.approx(fit.cap_deg, abs=1e-6)
    np.testing.assert_allclose(moved.residuals_mm, fit.residuals_mm, atol=1e-7)


@given(seed=seeds, factor=st.sampled_from([1e-3, 1e3]))
@few
def test_scaling_and_order_do_not_matter(seed, factor):
    rng = np.random.default_rng(seed)
    points = cap(rng) + rng.normal(0, 0.3, (60, 3))
    fit, scaled = fit_sphere(points), fit_sphere(factor * rng.permutation(points))
    np.testing.assert_allclose(scaled.center / factor, fit.center, atol=1e-6)
    assert scaled.center_sigma_mm / factor == pytest.approx(fit.center_sigma_mm, rel=1e-6)


@pytest.mark.parametrize("half_angle_deg", [12.0, 25.0, 70.0])
def test_no_other_sphere_is_closer(half_angle_deg):
    rng = np.random.default_rng(5)
    points = cap(rng, n=200, half_angle_deg=half_angle_deg) + rng.normal(0, 0.2, (200, 3)) + 1000.0
    fit = fit_sphere(points)
    oracle = least_squares(
        lambda x: np.linalg.norm(points - x[:3], axis=1) - x[3],
        [1000.0, 1000.0, 1000.0, 200.0],
        x_scale="jac",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    np.testing.assert_allclose(np.append(fit.center, fit.radius_mm), oracle.x, atol=1e-4)
    assert fit.rms_mm**2 * 200 <= 2 * oracle.cost * (1 + 1e-12)


def test_the_predicted_uncertainty_matches_the_scatter_over_many_caps():
    errors, predicted = [], []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        fit = fit_sphere(cap(rng, n=100, half_angle_deg=30) + rng.normal(0, 0.2, (100, 3)))
        errors.append(fit.center @ fit.center)
        predicted.append(fit.center_sigma_mm**2)
    assert np.mean(errors) / np.mean(predicted) == pytest.approx(1.0, abs=0.35)


def test_small_caps_are_not_pulled_to_small_spheres():
    radii = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        points = cap(rng, n=400, half_angle_deg=15) + rng.normal(0, 0.2, (400, 3))
        radii.append(fit_sphere(points).radius_mm)
    spread = np.std(radii) / np.sqrt(len(radii))
    assert abs(np.mean(radii) - 200.0) < 3.5 * spread


def test_four_points_give_the_sphere_through_them():
    fit = fit_sphere(np.vstack((np.eye(3), -np.eye(3)[:1])) + 5.0)
    np.testing.assert_allclose(fit.center, (5, 5, 5), atol=1e-12)
    assert fit.radius_mm == pytest.approx(1.0)
    assert fit.center_sigma_mm == 0.0
    np.testing.assert_array_equal(fit.center_covariance, np.zeros((3, 3)))


def test_degenerate_points_are_refused_by_name():
    rng = np.random.default_rng(1)
    circle = np.column_stack((np.cos(t := np.linspace(0, 6, 50)), np.sin(t), 0 * t)) * 200
    for flat in (thin_points(rng, 60, 0.1), np.zeros((6, 3)), circle):
        with pytest.raises(DegenerateGeometryError, match="flat"):
            fit_sphere(flat)
    with pytest.raises(DegenerateGeometryError, match="too small for its noise"):
        fit_sphere(cap(rng, n=30, half_angle_deg=4) + rng.normal(0, 0.5, (30, 3)))
    with pytest.raises(DegenerateGeometryError, match="too small for its noise"):
        fit_sphere(thin_points(rng, 60, 2.0))
    with pytest.raises(InvalidInputError):
        fit_sphere(np.eye(3))
    with pytest.raises(InvalidInputError, match="finite"):
        fit_sphere(np.vstack((np.eye(3), [[np.nan, 0, 0]])))
