import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.virtual.acoustics.microstructure import LATERAL_CELL_MM, cells, grains

seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds)
@settings(max_examples=20)
def test_grains_are_white_with_rms_one(seed):
    points = np.random.default_rng(seed).uniform(-80, 80, (3000, 3))
    g = grains(cells(points, seed), 8)
    assert abs(g.mean()) < 0.03
    assert abs(g.std() - 1.0) < 0.03
    correlation = np.corrcoef(g.T) - np.eye(8)
    assert np.abs(correlation).max() < 0.1


@given(seed=seeds)
@settings(max_examples=20)
def test_the_same_place_has_the_same_grains_and_other_places_or_seeds_others(seed):
    points = np.random.default_rng(seed).uniform(-80, 80, (200, 3))
    middle = (np.floor(points / LATERAL_CELL_MM) + 0.5) * LATERAL_CELL_MM
    here = cells(middle, seed)
    np.testing.assert_array_equal(here, cells(middle + 0.4 * LATERAL_CELL_MM, seed))
    assert not np.any(here == cells(middle + (0, 0, LATERAL_CELL_MM), seed))
    assert not np.any(here == cells(middle, seed + 1))
