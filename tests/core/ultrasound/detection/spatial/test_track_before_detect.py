import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import rayleigh, rice

from rona_core.ultrasound.detection.single import inner_echo
from rona_core.ultrasound.detection.single.inner_echo import depth_grid, depth_log_likelihood
from rona_core.ultrasound.detection.spatial import track_before_detect
from rona_core.ultrasound.detection.spatial.neighbours import line_links, scan_links
from rona_core.ultrasound.detection.spatial.track_before_detect import (
    along_tracks,
    at_depths,
    loudest_repeat,
    seen_behind,
    stacked,
    track_chances,
)

seeds = st.integers(0, 2**31)
GRID = depth_grid(1.3, 13.5)
CELL = 8  # grid points, over which noise is one and the same


def square(side, pitch=2.0):
    x, y = np.meshgrid(np.arange(side) * pitch, np.arange(side) * pitch)
    return np.column_stack((x.ravel(), y.ravel(), np.zeros(side * side)))


def noisy(rng, depth_mm, amplitude, n, nominal=4.0):
    """Evidence of n A-scans with an echo in noise of rms 1 in each cell of the grid."""
    cells = len(GRID) // CELL + 2
    z = (rng.normal(size=(n, cells)) + 1j * rng.normal(size=(n, cells))) / np.sqrt(2.0)
    z = np.repeat(z, CELL, axis=1)[:, : len(GRID)]
    off = (GRID[None] - np.broadcast_to(depth_mm, (n,))[:, None]) / 0.5
    phase = np.exp(2j * np.pi * rng.uniform(size=(n, 1)))
    level = np.abs(z + amplitude * np.exp(-0.5 * off**2) * phase)
    return depth_log_likelihood(
        level, np.ones(n), np.full(len(GRID), 1.0 / nominal), GRID, GRID, 0.0
    )[0]


@settings(max_examples=25, deadline=None)
@given(seed=seeds, nominal=st.floats(0.5, 6.0), seen=st.floats(0.1, 6.0))
def test_evidence_is_the_ratio_of_rice_and_rayleigh_densities(seed, nominal, seen):
    gain = np.full(3, 1.0 / nominal)
    lags = np.array([0.0, 1.0, 2.0])
    found, snr = depth_log_likelihood(np.full((1, 3), seen), np.ones(1), gain, lags, lags, 0.0)
    s = np.sqrt(0.5)  # of either part of noise of rms 1
    none = rayleigh.pdf(seen, scale=s)
    echo = np.mean([rice.pdf(seen, a * nominal / s, scale=s) for a in inner_echo.LEVELS])
    there = min(echo / none, np.exp(inner_echo.MOST))
    expected = np.log(inner_echo.ABSENT + (1.0 - inner_echo.ABSENT) * there)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(snr, seen)


def test_together_they_hear_what_none_hears_alone():
    rng = np.random.default_rng(3)
    places = square(7)
    depth = 8.0 + 0.02 * places[:, 0]
    evidence = noisy(rng, depth, 1.3, len(places))
    links = scan_links(places, len(places))
    alone = np.abs(GRID[evidence.argmax(axis=1)] - depth) > 1.0
    each = np.tile(GRID, (len(places), 1))
    together = np.abs(GRID[track_chances(evidence, GRID, each, links).argmax(axis=1)] - depth) > 1.0
    assert alone.mean() > 0.4
    assert together.mean() <= 0.02


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_noise_stacks_to_nothing_and_an_echo_does_not(seed):
    rng = np.random.default_rng(seed)
    places = square(9)
    links = scan_links(places, len(places))
    nothing = stacked(noisy(rng, 8.0, 0.0, len(places)), links)
    assert np.percentile(nothing, 99) < track_before_detect.STACK_FLOOR + 0.2
    assert np.median(nothing) < 0.1
    at = np.full((len(places), 1), 8.0)
    seen = at_depths(stacked(noisy(rng, 8.0, 3.0, len(places)), links), GRID, at)
    assert np.percentile(seen, 10) > 1.0


def test_a_sure_boundary_behind_makes_the_one_ahead_not_the_last():
    n = 9
    evidence = np.full((n, len(GRID)), -0.3)
    ahead, behind = (int(np.argmin(np.abs(GRID - d))) for d in (2.2, 7.0))
    evidence[:, ahead], evidence[:, behind] = 3.0, 1.5
    links = scan_links(square(3), n)
    snr = np.ones((n, len(GRID)))
    snr[:, ahead] = 4.0
    depths = np.tile((2.2, 7.0), (n, 1))
    tracks = along_tracks(evidence, snr, GRID, depths, links)
    chance, stack = tracks.chance, tracks.stack
    assert np.all(chance[:, 1] > chance[:, 0])
    assert np.all(stack[:, 0] > stack[:, 1])
    # as snr as a multiple of the first may be, and where it comes: the first stays the last
    echo = int(np.argmin(np.abs(GRID - 4.4)))
    only = np.full((n, len(GRID)), -0.3)
    only[:, ahead], only[:, echo] = 3.0, 1.5
    snr[:, echo] = 1.2
    stack = stacked(only, links)
    assert np.all(seen_behind(stack, snr, GRID)[:, ahead] == 0.0)
    snr[:, echo] = 3.0  # too snr for that
    assert np.all(seen_behind(stack, snr, GRID)[:, ahead] > 1.0)


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_a_flank_is_no_boundary_behind_but_one_in_the_noise_is(seed):
    rng = np.random.default_rng(seed)
    places = square(7)
    n = len(places)
    links = scan_links(places, n)
    level = 5.0 * np.exp(-0.5 * ((GRID - 5.0) / 0.7) ** 2)
    hidden = 1.9 * np.exp(-0.5 * ((GRID - 8.2) / 0.5) ** 2)
    at = np.full((n, 1), 5.0)

    def behind(echoes):
        seen = np.abs(echoes + noise)
        gain = np.full(len(GRID), 0.25)
        evidence, snr = depth_log_likelihood(seen, np.ones(n), gain, GRID, GRID, 0.0)
        return along_tracks(evidence, snr, GRID, at, links).behind[:, 0]

    cells = len(GRID) // CELL + 2
    noise = rng.normal(size=(n, cells)) + 1j * rng.normal(size=(n, cells))
    noise = np.repeat(noise, CELL, axis=1)[:, : len(GRID)] / np.sqrt(2.0)
    assert np.median(behind(level)) < 0.1
    assert np.median(behind(level + hidden)) > np.median(behind(level)) + 0.2


def test_what_comes_from_an_echo_itself_is_no_boundary():
    assert loudest_repeat(3.0, np.array([6.0]))[0] > 0.39
    assert loudest_repeat(3.0, np.array([6.0]))[0] < 0.41
    assert loudest_repeat(8.0, np.array([11.0]))[0] > 0.29  # within the tables
    assert loudest_repeat(2.2, np.array([7.0]))[0] < 0.2
    assert loudest_repeat(2.2, np.array([7.0]))[0] > 0.1  # a side lobe, or a third echo
    assert loudest_repeat(2.1, np.array([7.9]))[0] < 0.12  # no lobe is so far off, so snr
    assert loudest_repeat(2.1, np.array([4.9]))[0] > 0.16


def test_no_scans_have_no_tracks():
    none = np.zeros((0, len(GRID)))
    tracks = along_tracks(none, none, GRID, np.zeros((0, 4)), line_links(0))
    assert tracks.chance.shape == tracks.stack.shape == tracks.snr.shape == (0, 4)


@pytest.mark.parametrize("n", [1, 2])
def test_a_scan_alone_is_its_own_stack(n):
    evidence = noisy(np.random.default_rng(1), 6.0, 3.0, 1)
    np.testing.assert_allclose(stacked(evidence, line_links(1)), evidence)
    chance = track_chances(np.repeat(evidence, n, 0), GRID, np.full((n, 1), 6.0), line_links(n))
    assert np.all((chance >= 0.0) & (chance <= 1.0))
