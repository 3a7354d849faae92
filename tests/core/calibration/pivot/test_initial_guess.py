"""The first guess of tip and pivot: exact without noise, and whatever a third of the poses say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.calibration.pivot.maximum_likelihood import robust_initial_guess
from tests.helpers.pivots import PIVOT, TIPS, orientations


def sweep(dof, seed=0, n=40, cone_deg=25.0):
    """Return levers and origins of poses whose tip stands exactly on the pivot."""
    rotations = orientations(np.random.default_rng(seed), dof, n, cone_deg)
    origins = PIVOT - rotations @ TIPS[dof]
    return (rotations if dof == 6 else rotations[:, :, 2:]), origins


def truth(dof):
    return np.concatenate((TIPS[6], PIVOT) if dof == 6 else (TIPS[5][2:], PIVOT))


@pytest.mark.parametrize("dof", [5, 6])
@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), n=st.integers(6, 60), cone_deg=st.floats(12.0, 50.0))
def test_without_noise_it_is_exact(dof, seed, n, cone_deg):
    levers, origins = sweep(dof, seed, n, cone_deg)
    found = robust_initial_guess(levers, origins, np.ones(n, dtype=bool))
    np.testing.assert_allclose(found, truth(dof), atol=1e-4)


@pytest.mark.parametrize("dof", [5, 6])
@pytest.mark.parametrize("seed", range(4))
def test_a_third_of_the_poses_may_say_anything(dof, seed):
    levers, origins = sweep(dof, seed, 60)
    rng = np.random.default_rng(seed)
    wrong = rng.permutation(60)[:20]
    origins[wrong] += rng.normal(0.0, 60.0, (20, 3)) + (30.0, 0.0, 0.0)
    found = robust_initial_guess(levers, origins, np.ones(60, dtype=bool))
    np.testing.assert_allclose(found, truth(dof), atol=1e-4)


def test_poses_that_do_not_count_have_no_say():
    levers, origins = sweep(6, 1, 50)
    keep = np.arange(50) % 5 < 2
    origins[~keep] += (80.0, -50.0, 20.0)
    np.testing.assert_allclose(robust_initial_guess(levers, origins, keep), truth(6), atol=1e-4)


def test_the_same_poses_give_the_same_guess():
    levers, origins = sweep(6, 2, 50)
    origins = origins + np.random.default_rng(3).normal(0.0, 0.5, (50, 3))
    keep = np.ones(50, dtype=bool)
    first = robust_initial_guess(levers, origins, keep)
    np.testing.assert_array_equal(first, robust_initial_guess(levers, origins, keep))
    assert np.linalg.norm(first - truth(6)) < 6.0
