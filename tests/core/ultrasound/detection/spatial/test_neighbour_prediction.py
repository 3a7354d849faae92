import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.ultrasound.detection.spatial.neighbours import (
    BENT_US_PER_MM,
    STEEP_US_PER_MM,
    line_links,
    predict_lags,
    scan_links,
)

SIDE = 9
X, Y = np.meshgrid(np.arange(float(SIDE)), np.arange(float(SIDE)))
PLACES = np.column_stack((X.ravel(), Y.ravel(), np.zeros(SIDE * SIDE)))
MIDDLE = SIDE * SIDE // 2
N = len(PLACES)


@settings(max_examples=20, deadline=None)
@given(a=st.floats(-0.2, 0.2), b=st.floats(-0.2, 0.2))
def test_on_a_plane_each_is_expected_where_it_is_even_at_the_rim(a, b):
    lag = 4.0 + PLACES[:, :2] @ (a, b)
    links = scan_links(PLACES, N)
    expected, sd, steep = predict_lags(lag, np.full(N, 0.02), np.ones(N, dtype=bool), links)
    np.testing.assert_allclose(expected, lag, atol=2e-3)
    np.testing.assert_allclose(steep, np.hypot(a, b), atol=2e-3)
    assert np.all(sd < 0.03)


def test_one_that_is_wrong_moves_neither_itself_nor_others():
    lag = 4.0 + PLACES[:, :2] @ (0.1, -0.05)
    links = scan_links(PLACES, N)
    wrong = lag.copy()
    wrong[MIDDLE] += 1.0
    expected, _, _ = predict_lags(wrong, np.full(N, 0.03), np.ones(N, dtype=bool), links)
    assert expected[MIDDLE] == pytest.approx(lag[MIDDLE], abs=2e-3)
    np.testing.assert_allclose(expected, lag, atol=0.01)


def test_the_sd_is_that_of_what_is_expected():
    rng = np.random.default_rng(5)
    links = scan_links(PLACES, N)
    sigma, counts = np.full(N, 0.1), np.ones(N, dtype=bool)
    errors, stated = [], []
    for _ in range(60):
        expected, sd, _ = predict_lags(4.0 + rng.normal(0.0, 0.1, N), sigma, counts, links)
        errors.append(expected[MIDDLE] - 4.0)
        stated.append(sd[MIDDLE])
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) / np.mean(stated) < 1.3
    assert np.mean(stated) < 0.1 / 3.0  # two dozen know better than one


def test_it_does_not_matter_how_the_scan_is_turned():
    rng = np.random.default_rng(6)
    xy = rng.uniform(0.0, 12.0, (60, 2))
    places = np.column_stack((xy, np.zeros(60)))
    c, s = np.cos(0.7), np.sin(0.7)
    turned = places @ np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))
    lag, sigma = rng.normal(4.0, 0.1, 60), rng.uniform(0.02, 0.2, 60)
    every = np.ones(60, dtype=bool)
    here, there = (predict_lags(lag, sigma, every, scan_links(p, 60)) for p in (places, turned))
    for one, other in zip(here, there, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)


def test_who_has_too_few_around_expects_nothing():
    lag = np.linspace(4.0, 5.0, N)
    links = scan_links(PLACES, N)
    expected, sd, steep = predict_lags(lag, np.full(N, 0.1), np.zeros(N, dtype=bool), links)
    np.testing.assert_array_equal(expected, lag)
    assert np.all(np.isinf(sd))
    np.testing.assert_array_equal(steep, 0.0)
    alone = predict_lags(lag[:1], np.full(1, 0.1), np.ones(1, dtype=bool), line_links(1))
    assert np.isinf(alone[1][0])


def test_one_neighbour_is_as_sure_as_it_is_near():
    pair = np.array(((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)))
    sigma = np.array((0.5, 0.03))
    links = scan_links(pair, 2)
    lag, both = np.array((4.0, 4.2)), np.ones(2, dtype=bool)
    expected, sd, steep = predict_lags(lag, sigma, both, links)
    np.testing.assert_allclose(expected, lag[::-1], atol=1e-6)
    bend = 2.0 * BENT_US_PER_MM
    np.testing.assert_allclose(
        sd, np.sqrt(sigma[::-1] ** 2 + bend**2 + (2.0 * STEEP_US_PER_MM) ** 2), rtol=1e-6
    )
    np.testing.assert_array_equal(steep, 0.0)
