"""Pivot by sphere or by linear equations: exact without noise, and where gross errors are left."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.calibration.pivot.algebraic import solve_linear, without_gross_errors
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.pose import Pose, Poses
from tests.helpers.pivots import PIVOT, TIPS, orientations


def sweep(dof, n=40, seed=0, cone_deg=25.0):
    """Return poses whose tip stands exactly on the pivot."""
    rotations = orientations(np.random.default_rng(seed), dof, n, cone_deg)
    return Poses(rotations, PIVOT - rotations @ TIPS[dof])


@pytest.mark.parametrize("method", ["sphere", "aos"])
@pytest.mark.parametrize("dof", [5, 6])
@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), cone_deg=st.floats(15.0, 50.0))
def test_without_noise_tip_and_pivot_are_exact(dof, method, seed, cone_deg):
    found = solve_linear(sweep(dof, seed=seed, cone_deg=cone_deg), dof, method)
    np.testing.assert_allclose(found.tip_marker, TIPS[dof], atol=1e-5)
    np.testing.assert_allclose(found.pivot_tracker, PIVOT, atol=1e-5)
    assert found.tip_sigma_mm < 1e-5


@pytest.mark.parametrize("method", ["sphere", "aos"])
def test_the_pivot_moves_with_the_tracker_and_the_tip_does_not(method):
    made = sweep(6)
    rng = np.random.default_rng(1)
    noisy = Poses(made.rotations, made.translations + rng.normal(0.0, 0.1, (len(made), 3)))
    moved = Pose.from_rotvec((0.3, -0.8, 0.5), (100.0, -40.0, 900.0))
    before = solve_linear(noisy, 6, method)
    after = solve_linear(moved @ noisy, 6, method)
    np.testing.assert_allclose(after.tip_marker, before.tip_marker, atol=1e-6)
    np.testing.assert_allclose(after.pivot_tracker, moved @ before.pivot_tracker, atol=1e-6)
    assert after.tip_sigma_mm == pytest.approx(before.tip_sigma_mm)


def test_the_linear_equations_state_the_scatter_that_noise_makes():
    """Over many sweeps the tip scatters by what one of them says."""
    made, tips, stated = sweep(6, n=60), [], []
    for seed in range(300):
        noise = np.random.default_rng(seed).normal(0.0, 0.2, (len(made), 3))
        found = solve_linear(Poses(made.rotations, made.translations + noise), 6, "aos")
        tips.append(found.tip_marker)
        stated.append(found.tip_sigma_mm)
    scatter = np.sqrt(np.var(tips, axis=0, ddof=1).sum())
    assert np.mean(stated) == pytest.approx(scatter, rel=0.08)


@pytest.mark.parametrize("method", ["sphere", "aos"])
def test_poses_that_slipped_are_left_out_and_no_others(method):
    made = sweep(6, n=50)
    shifts = np.random.default_rng(2).normal(0.0, 0.05, (50, 3))
    shifts[[4, 17, 30]] += (8.0, -6.0, 5.0)
    slipped = Poses(made.rotations, made.translations + shifts)
    good = without_gross_errors(slipped, np.ones(50, dtype=bool), 6, method, 10)
    np.testing.assert_array_equal(np.flatnonzero(~good), (4, 17, 30))


def test_too_many_that_slipped_are_refused():
    made = sweep(6, n=50)
    shifts = np.zeros((50, 3))
    shifts[::3] = np.random.default_rng(3).normal(0.0, 40.0, (17, 3))
    slipped = Poses(made.rotations, made.translations + shifts)
    with pytest.raises(DegenerateGeometryError, match="the tip has slipped"):
        without_gross_errors(slipped, np.ones(50, dtype=bool), 6, "aos", 10)
