"""Chance that a time is a cycle off, from likelihoods that are known."""

import numpy as np
import pytest

from rona_core.ultrasound.detection.spatial.oblique_correction import (
    MOST_RATIO,
    SLIP_ODDS,
    slip_chances,
)

PERIOD_US = 0.4
OFFSETS_US = np.arange(-30, 31) * PERIOD_US / 18.0


def peaks(*heights: float) -> np.ndarray:
    """Return log likelihoods (1, t) with a peak at -1, 0 and 1 cycles."""
    away = (OFFSETS_US[:, None] / PERIOD_US - np.array((-1.0, 0.0, 1.0))) / 0.1
    return (np.array(heights) - 0.5 * away**2).max(axis=1)[None]


def chance(likelihood: np.ndarray, found: float = 0.0, sigma_us: float = 0.04) -> float:
    found_us, sigma = np.array([found * PERIOD_US]), np.array([sigma_us])
    return float(slip_chances(likelihood, OFFSETS_US, found_us, sigma, PERIOD_US)[0])


def test_two_cycles_that_explain_an_echo_alike_leave_the_odds_of_the_first_fit():
    odds = SLIP_ODDS * 0.04 / PERIOD_US
    assert chance(peaks(0.0, 0.0, -50.0)) == pytest.approx(odds / (1.0 + odds), rel=1e-6)


@pytest.mark.parametrize("ratio", [-8.0, -4.0, 2.0])
def test_the_likelihood_ratio_counts_by_its_root(ratio):
    alike = chance(peaks(0.0, 0.0, -50.0))
    now = chance(peaks(-50.0, 0.0, ratio))
    assert now / (1.0 - now) == pytest.approx(alike / (1.0 - alike) * np.exp(ratio / 2), rel=1e-6)


def test_either_neighbouring_cycle_counts_and_no_other_peak():
    assert chance(peaks(1.0, 0.0, -9.0)) == pytest.approx(chance(peaks(-9.0, 0.0, 1.0)))
    twice = peaks(-9.0, 0.0, -9.0)
    twice[0, np.abs(np.abs(OFFSETS_US) / PERIOD_US - 1.6) < 0.1] = 5.0  # another echo
    assert chance(twice) == pytest.approx(chance(peaks(-9.0, 0.0, -9.0)))


def test_it_is_told_from_where_the_time_was_found_not_from_where_it_was_sought_first():
    late = chance(peaks(-50.0, 3.0, 0.0), found=1.0)
    right = chance(peaks(-50.0, 3.0, 0.0), found=0.0)
    assert late > 4.0 * right


def test_a_wider_first_fit_slips_more_often():
    narrow, wide = (chance(peaks(-4.0, 0.0, -6.0), sigma_us=s) for s in (0.02, 0.08))
    assert wide == pytest.approx(4.0 * narrow, rel=0.05)


def test_it_is_a_chance_whatever_the_likelihoods_are():
    certain = chance(peaks(1e6, 0.0, 0.0))
    assert certain == pytest.approx(chance(peaks(MOST_RATIO, 0.0, 0.0)))
    assert 0.0 < chance(peaks(-1e6, 0.0, -1e6)) < certain < 1.0
