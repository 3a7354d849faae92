"""Alignment of echoes against copies whose delays, levels and noise are known."""

import numpy as np
import pytest
from scipy.signal import hilbert

from rona_core.ultrasound.recorded.band import Band
from rona_core.ultrasound.recorded.template_learning import align_echoes, locate_echoes

RATE_MHZ, SAMPLES, CENTER = 40.0, 1024, 500
BAND = Band(2.25, 1.4)


def lines(delays_us, levels=None, noise=0.0, seed=0):
    """Return analytic lines with one echo each, ``delays_us`` after the sample CENTER."""
    delays_us = np.asarray(delays_us)
    levels = np.ones(len(delays_us)) if levels is None else np.asarray(levels)
    t = (np.arange(SAMPLES) - CENTER) / RATE_MHZ - delays_us[:, None]
    pulse = np.exp(-((t * BAND.width_mhz * 1.2) ** 2)) * np.cos(
        2 * np.pi * BAND.centre_mhz * t + 0.4
    )
    rf = levels[:, None] * pulse
    rf = rf + noise * np.random.default_rng(seed).normal(size=rf.shape)
    return hilbert(rf, axis=1)


def aligned(z, **changes):
    n = len(z)
    arguments = {"centers": np.full(n, CENTER), "used": np.ones(n, dtype=bool), **changes}
    return align_echoes(z, arguments["centers"], arguments["used"], RATE_MHZ, BAND, search_us=1.5)


DELAYS_US = np.random.default_rng(1).uniform(-0.15, 0.15, 24)


def test_delays_between_copies_are_found_to_a_thousandth_of_a_sample():
    found = aligned(lines(DELAYS_US))
    apart = (found.at_us - found.at_us[0]) - (DELAYS_US - DELAYS_US[0])
    assert np.abs(apart).max() * RATE_MHZ < 0.01
    np.testing.assert_allclose(found.correlation, 1.0, atol=1e-3)


def test_levels_are_those_of_the_copies():
    levels = np.random.default_rng(2).uniform(0.5, 2.0, 24)
    found = aligned(lines(DELAYS_US, levels))
    ratio = found.level / levels
    np.testing.assert_allclose(ratio, ratio[0], rtol=5e-3)


def test_noise_scatters_them_as_little_as_it_may():
    """The Cramér-Rao bound of a known echo in white noise, and not more than twice it."""
    noise = 0.05
    found = aligned(lines(DELAYS_US, noise=noise))
    apart = found.at_us - DELAYS_US
    clean = lines([0.0])[0].real
    slope = np.gradient(clean, 1.0 / RATE_MHZ)
    bound_us = noise / np.sqrt((slope**2).sum())
    assert 0.5 * bound_us < (apart - apart.mean()).std() < 2.0 * bound_us


def test_a_line_without_the_echo_does_not_enter_the_mean():
    z = lines(DELAYS_US)
    spoiled = np.concatenate((z, lines([0.0] * 3, [0.0] * 3, noise=1.0)))
    found = aligned(spoiled)
    assert found.correlation[-3:].max() < 0.8
    apart = (found.at_us[:24] - found.at_us[0]) - (DELAYS_US - DELAYS_US[0])
    assert np.abs(apart).max() * RATE_MHZ < 0.02


def test_the_mean_of_some_is_found_in_others():
    learned = aligned(lines(DELAYS_US))
    others = np.array((-0.4, 0.0, 0.73))
    found = locate_echoes(lines(others), np.full(3, CENTER), learned, RATE_MHZ, BAND, search_us=1.5)
    np.testing.assert_allclose(found.at_us - found.at_us[1], others, atol=0.2 / RATE_MHZ)
    beside = locate_echoes(
        lines(others), np.full(3, CENTER + 20), learned, RATE_MHZ, BAND, search_us=1.5
    )
    np.testing.assert_allclose(beside.at_us, found.at_us, atol=0.2 / RATE_MHZ)


@pytest.mark.parametrize("search_us", [0.1, 0.2])
def test_an_echo_is_sought_no_farther_than_told(search_us):
    learned = aligned(lines(DELAYS_US))
    start = locate_echoes(lines([0.0]), np.array([CENTER]), learned, RATE_MHZ, BAND, search_us=1.0)
    far = locate_echoes(
        lines([1.0]), np.array([CENTER]), learned, RATE_MHZ, BAND, search_us=search_us
    )
    reach_us = far.at_us[0] - CENTER / RATE_MHZ
    assert abs(reach_us) <= search_us + 0.5 / RATE_MHZ
    assert start.correlation[0] > 0.99
