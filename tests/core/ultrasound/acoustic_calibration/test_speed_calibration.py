"""Sound speed from reference points: against a brute-force posterior, and with bad points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.reference.thickness_budget import thickness_budget
from rona_core.errors import InvalidInputError
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    PUBLISHED,
    SpeedPrior,
    calibrate_speed,
    speed_at,
    uncalibrated,
)

NOMINAL = PUBLISHED.mean_mm_per_us


def points(n, speed=2.8, seed=0, caliper_mm=0.0):
    rng = np.random.default_rng(seed)
    d = rng.uniform(4.0, 9.0, n)
    return d + rng.normal(0, caliper_mm, n) if caliper_mm else d, 2 * d / speed


@pytest.mark.parametrize("n", [1, 2])
def test_mean_and_sigma_are_those_of_the_posterior_on_a_grid(n):
    d, lag = points(n, speed=2.75)
    found = calibrate_speed(d, lag, thickness_sigma_mm=0.1, lag_sigma_us=0.02)
    grid = np.linspace(1.8, 3.6, 20001)
    log = -0.5 * ((grid - NOMINAL) / PUBLISHED.patient_sd_mm_per_us) ** 2
    for x, t in zip(d, lag, strict=True):
        c = 2 * x / t
        sd2 = (0.2 / t) ** 2 + (c * 0.02 / t) ** 2 + PUBLISHED.local_sd_mm_per_us**2
        log -= 0.5 * (c - grid) ** 2 / sd2
    p = np.exp(log - log.max())
    p /= p.sum()
    mean = (p * grid).sum()
    assert found.speed_mm_per_us == pytest.approx(mean, abs=1e-6)
    assert found.sigma_mm_per_us == pytest.approx(np.sqrt((p * (grid - mean) ** 2).sum()), rel=1e-4)


@given(n=st.integers(1, 8), speed=st.floats(2.4, 2.9), seed=st.integers(0, 99))
@settings(max_examples=25, deadline=None)
def test_the_mean_lies_between_prior_and_points_and_more_points_are_surer(n, speed, seed):
    d, lag = points(n, speed, seed)
    found = calibrate_speed(d, lag)
    low, high = sorted((NOMINAL, speed))
    assert low - 1e-9 <= found.speed_mm_per_us <= high + 1e-9
    more = calibrate_speed(np.tile(d, 2), np.tile(lag, 2))
    if n >= 3 or 2 * n < 3:  # with few points none is weighted down
        assert more.sigma_mm_per_us <= found.sigma_mm_per_us + 1e-12
    assert found.sigma_mm_per_us < uncalibrated().sigma_mm_per_us


def test_the_order_of_the_points_does_not_matter():
    d, lag = points(5, caliper_mm=0.2)
    order = np.array([3, 1, 4, 0, 2])
    a, b = calibrate_speed(d, lag), calibrate_speed(d[order], lag[order])
    assert a.speed_mm_per_us == pytest.approx(b.speed_mm_per_us, abs=1e-12)
    np.testing.assert_allclose(a.residuals_mm[order], b.residuals_mm, atol=1e-12)


def test_one_wrong_echo_among_five_is_named_and_hardly_counts():
    d, lag = points(5, 2.75)
    clean = calibrate_speed(d, lag)
    assert clean.verdict == "good"
    lag[2] *= 1.5  # a later echo
    found = calibrate_speed(d, lag)
    assert found.verdict == "weak"
    assert "point 3 does not agree" in found.reasons[0]
    assert found.weights[2] == found.weights.min() < 0.4
    assert abs(found.speed_mm_per_us - clean.speed_mm_per_us) < 0.05


def test_verdicts():
    d, lag = points(1)
    assert calibrate_speed(d, lag).verdict == "weak"
    assert "1 of 3 reference points" in calibrate_speed(d, lag).reasons
    twice = calibrate_speed(d, 2 * lag)  # a multiple
    assert twice.verdict == "bad"
    thin = calibrate_speed([2.0, 2.2, 2.4], 2 * np.array([2.0, 2.2, 2.4]) / 2.7)
    assert any("thin" in reason for reason in thin.reasons)
    assert uncalibrated().verdict == "weak"


def test_the_field_is_the_points_own_near_them_and_the_mean_far_away():
    place = np.array([[0.0, 0.0], [30.0, 0.0], [0.0, 30.0]])
    speeds = np.array([2.62, 2.72, 2.66])
    d = np.full(3, 8.0)
    found = calibrate_speed(
        d, 2 * d / speeds, thickness_sigma_mm=0.01, lag_sigma_us=0.001, positions_mm=place
    )
    at, sigma = speed_at(found, place)
    np.testing.assert_allclose(at, speeds, atol=0.01)
    assert sigma.max() < 0.01
    far, far_sigma = speed_at(found, [[500.0, 0.0]])
    assert far[0] == pytest.approx(found.speed_mm_per_us, abs=0.02)
    assert far_sigma[0] > PUBLISHED.local_sd_mm_per_us
    moved = calibrate_speed(
        d, 2 * d / speeds, thickness_sigma_mm=0.01, lag_sigma_us=0.001, positions_mm=place + 7.0
    )
    np.testing.assert_allclose(speed_at(moved, place + 7.0)[0], at, atol=1e-9)


def test_the_budget_adds_up_and_is_in_proportion_to_thickness():
    found = uncalibrated()
    six = thickness_budget(6.0, found, lag_sigma_us=0.03, wedge_sigma_mm=0.05)
    parts = (six.patient_mm, six.local_mm, six.timing_mm, six.wedge_mm)
    assert six.sigma_mm[0] == pytest.approx(float(np.sqrt(sum(p[0] ** 2 for p in parts))))
    assert six.patient_mm[0] == pytest.approx(0.18)
    assert six.timing_mm[0] == pytest.approx(0.03 * NOMINAL / 2)
    twelve = thickness_budget([6.0, 12.0], found)
    assert twelve.local_mm[1] == pytest.approx(2 * twelve.local_mm[0])
    better = thickness_budget(6.0, calibrate_speed(*points(5)))
    assert better.sigma_mm[0] < six.sigma_mm[0]


def test_the_predicted_sigma_is_that_of_simulated_patients():
    rng = np.random.default_rng(8)
    errors, sigmas = [], []
    for _ in range(600):
        mean = NOMINAL + PUBLISHED.patient_sd_mm_per_us * rng.standard_normal()
        d = rng.uniform(4, 9, 3)
        lag = 2 * d / (mean + PUBLISHED.local_sd_mm_per_us * rng.standard_normal(3))
        found = calibrate_speed(d + rng.normal(0, 0.1, 3), lag, lag_sigma_us=0.0)
        errors.append(found.speed_mm_per_us - mean)
        sigmas.append(found.sigma_mm_per_us)
    assert 0.85 < np.std(errors) / np.mean(sigmas) < 1.15
    assert abs(np.mean(errors)) < 0.005


@pytest.mark.parametrize(
    ("d", "lag", "options", "words"),
    [
        ([], [], {}, "each reference point"),
        ([5.0], [3.7, 3.8], {}, "each reference point"),
        ([5.0], [-3.7], {}, "lags above 0"),
        ([0.0], [3.7], {}, "thicknesses must be"),
        ([5.0], [float("nan")], {}, "finite"),
        ([5.0], [3.7e-6], {}, "two-way times in us"),
        ([5.0], [3.7], {"thickness_sigma_mm": 0.0}, "standard deviations"),
        ([5.0], [3.7], {"positions_mm": [[0.0, 0.0], [1.0, 1.0]]}, "positions"),
    ],
)
def test_what_no_point_can_be_is_refused(d, lag, options, words):
    with pytest.raises(InvalidInputError, match=words):
        calibrate_speed(d, lag, **options)


def test_priors_and_budgets_that_cannot_be_are_refused():
    with pytest.raises(InvalidInputError, match="speed in bone"):
        SpeedPrior(mean_mm_per_us=2850.0)
    with pytest.raises(InvalidInputError, match="spreads"):
        SpeedPrior(local_sd_mm_per_us=0.0)
    with pytest.raises(InvalidInputError, match="negative"):
        thickness_budget(-1.0, uncalibrated())
    known = calibrate_speed(*points(3), positions_mm=np.zeros((3, 2)))
    with pytest.raises(InvalidInputError, match="coordinates"):
        speed_at(known, [[0.0, 0.0, 0.0]])
