import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.ultrasound.detection.single.inner_echo import depth_grid
from rona_core.ultrasound.detection.spatial import track_before_detect as sgm
from rona_core.ultrasound.detection.spatial.neighbours import Links, line_links, scan_links
from rona_core.ultrasound.detection.spatial.track_before_detect import (
    candidate_probabilities,
    change_sd_mm,
    neighbour_density,
)

seeds = st.integers(0, 2**31)


def kernel(m, apart):
    gap = (np.arange(m)[:, None] - np.arange(m)[None]) * sgm.STEP_MM / change_sd_mm(apart)
    bell = np.exp(-0.5 * gap**2)
    bell /= bell.sum(axis=1, keepdims=True)
    return sgm.LINKED * bell + (1 - sgm.LINKED) / m


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_a_star_of_eight_lines_is_summed_exactly(seed):
    """Brute force: the depth of the middle scan against every depth of those around it."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(3) * 2.0, np.arange(3) * 2.0)
    places = np.column_stack((x.ravel(), y.ravel(), np.zeros(9)))
    m = 12
    own = rng.uniform(0.05, 4.0, (9, m))
    found = neighbour_density(own, scan_links(places, 9))[4]
    expected = np.ones(m)
    for j in (0, 1, 2, 3, 5, 6, 7, 8):  # one ring: nobody stands behind these
        apart = 2.0 if j % 2 else 2.0 * np.sqrt(2.0)
        classed = next(d for d in sgm.DISTANCES_MM if apart <= d)
        expected *= [sum(own[j, b] * kernel(m, classed)[b, a] for b in range(m)) for a in range(m)]
    np.testing.assert_allclose(found, expected / expected.mean(), rtol=1e-9)


def test_neighbours_outvote_a_stronger_stray_peak():
    n = 11
    depth = np.tile((4.0, 6.6), (n, 1))
    odds = np.tile((-2.0, 1.0), (n, 1))
    odds[5] = (1.5, 0.5)
    grid = depth_grid(1.4, 13.0)
    chances = candidate_probabilities(odds, depth, depth > 0, grid, line_links(n))
    assert odds[5, 0] > odds[5, 1]
    assert chances[5, 1] > 0.8
    np.testing.assert_allclose(chances.sum(axis=1), 1.0)


def test_a_scan_alone_keeps_its_own_odds():
    grid = depth_grid(1.4, 13.0)
    odds = np.array([[0.7, -1.0]])
    chances = candidate_probabilities(
        odds, np.array([[4.0, 8.0]]), np.ones((1, 2)) > 0, grid, line_links(1)
    )
    expected = np.append(np.exp(odds[0]), 1.0)
    np.testing.assert_allclose(chances[0], expected / expected.sum(), rtol=2e-3)


def test_a_missing_candidate_has_no_chance():
    chances = candidate_probabilities(
        np.array([[9.0, 0.0]]), np.array([[4.0, 8.0]]), np.array([[False, True]]),
        depth_grid(1.4, 13.0), line_links(1),
    )  # fmt: skip
    assert chances[0, 0] == 0.0


def test_far_neighbour_density_less():
    own = np.ones((2, 60))
    own[1, 30] = 200.0
    near, far = (
        neighbour_density(
            own,
            Links(
                np.array([[1, -1]]),
                np.array([[d, 0.0]]),
                np.array([[1, 0]]),
                np.array([[1, -1]]),
                np.array([[d, 0.0]]),
                np.array([[1, -1]]),
                np.array([[(d, 0.0), (0.0, 0.0)]]),
            ),
        )[0]
        for d in (1.0, 5.0)
    )
    assert near[30] > far[30] > 1.2
    assert change_sd_mm(np.array(4.0)) > change_sd_mm(np.array(1.0))


def test_no_scans_have_nothing_to_say():
    assert neighbour_density(np.zeros((0, 7)), line_links(0)).shape == (0, 7)


@pytest.mark.parametrize("n", [1, 2, 7])
def test_flat_evidence_stays_flat_in_the_middle(n):
    said = neighbour_density(np.ones((n, 80)), line_links(n))
    np.testing.assert_allclose(said[:, 20:60], said[:, 40:41].repeat(40, 1), rtol=5e-3)
