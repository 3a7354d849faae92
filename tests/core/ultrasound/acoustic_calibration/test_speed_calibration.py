"""Sound speed from reference points: against a brute-force posterior, and with bad points."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.reference.thickness_budget import thickness_budget
from rona_core.errors import InvalidInputError
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    GOOD_SHARE,
    calibrate_speed,
    speed_at,
    speed_covariance,
    uncalibrated,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import PUBLISHED, SpeedPrior

NOMINAL = PUBLISHED.mean_mm_per_us


def points(n, speed=2.8, seed=0, caliper_mm=0.0):
    rng = np.random.default_rng(seed)
    d = rng.uniform(4.0, 9.0, n)
    return d + rng.normal(0, caliper_mm, n) if caliper_mm else d, 2 * d / speed


@pytest.mark.parametrize("n", [1, 2])
def test_mean_and_sigma_are_those_of_the_posterior_on_a_grid(n):
    d, lag = points(n, speed=2.75)
    plain = SpeedPrior()  # places differ by the same in all patients, and lags share no error
    found = calibrate_speed(d, lag, thickness_sigma_mm=0.1, lag_sigma_us=0.02, prior=plain)
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


def test_what_all_lags_have_in_common_is_not_averaged_away():
    """The posterior on a grid over the mean and the time that all lags are off by."""
    d, lag = points(4, speed=2.7)
    prior = SpeedPrior(timing_us=0.05)
    found = calibrate_speed(
        d, lag, lag_sigma_us=0.01, prior=replace(prior, patient_sd_mm_per_us=0.9)
    )
    grid, shift = np.meshgrid(np.linspace(2.3, 3.1, 401), np.linspace(-0.3, 0.3, 301))
    log = -0.5 * ((grid - NOMINAL) / 0.9) ** 2 - 0.5 * (shift / 0.05) ** 2
    for x, t in zip(d, lag, strict=True):
        c = 2 * x / t
        sd2 = (0.2 / t) ** 2 + (c * 0.01 / t) ** 2 + PUBLISHED.local_sd_mm_per_us**2
        log -= 0.5 * (c + c / t * shift - grid) ** 2 / sd2
    p = np.exp(log - log.max())
    p /= p.sum()
    mean = (p * grid).sum()
    assert found.speed_mm_per_us == pytest.approx(mean, abs=1e-3)
    assert found.sigma_mm_per_us == pytest.approx(np.sqrt((p * (grid - mean) ** 2).sum()), rel=0.01)


def test_the_mean_over_a_region_is_that_of_the_speeds_at_its_places():
    rng = np.random.default_rng(1)
    place, region = rng.uniform(-20, 20, (4, 2)), rng.uniform(-25, 25, (150, 2))
    d, lag = points(4, speed=2.75, caliper_mm=0.1)
    found = calibrate_speed(d, lag, positions_mm=place, region_mm=region)
    assert found.speed_mm_per_us == pytest.approx(speed_at(found, region)[0].mean(), abs=1e-12)
    whole = speed_covariance(found, region)
    assert found.sigma_mm_per_us == pytest.approx(np.sqrt(whole.mean()), rel=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(whole)), speed_at(found, region)[1], rtol=1e-9)
    patient = calibrate_speed(d, lag, positions_mm=place)
    assert found.sigma_mm_per_us < patient.sigma_mm_per_us  # which is beyond the region too


def test_points_that_scatter_say_that_places_differ():
    place = 100.0 * np.arange(12.0)
    d = np.full(12, 9.0)
    spread = {}
    for share in (0.0, 0.06):
        speeds = 2.7 * (1.0 + share * np.tile((-1.0, 1.0), 6))
        spread[share] = calibrate_speed(d, 2 * d / speeds, lag_sigma_us=0.0, positions_mm=place)
    alike, apart = (spread[share].local_sd_mm_per_us for share in (0.0, 0.06))
    assert alike < PUBLISHED.local_sd_mm_per_us < apart
    assert alike < 0.6 * apart


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


def test_a_speed_that_is_not_known_well_enough_is_weak_and_says_what_to_do():
    d, lag = points(3, 2.7)
    rough = calibrate_speed(d, lag, thickness_sigma_mm=0.3)
    assert rough.share > GOOD_SHARE
    assert rough.verdict == "weak"
    assert "add points, at thick places" in rough.reasons[-1]
    contradicting = calibrate_speed(d, 2 * d / np.array([2.4, 2.75, 3.1]))
    assert contradicting.verdict == "bad"
    assert "do not agree" in contradicting.reasons[0]
    assert calibrate_speed([6.5, 4.5, 4.4], [4.75, 2.6, 2.55]).verdict == "bad"  # 3.46 mm/us twice


def test_what_is_called_good_is_good_in_nine_of_ten_patients():
    """Patients drawn from the ends of what is published, evenly, and not as the prior has it."""
    rng = np.random.default_rng(5)
    off, sigmas = [], []
    for _ in range(300):
        mean = rng.uniform(2.45, 2.85)
        place, region = rng.uniform(-25, 25, (4, 2)), rng.uniform(-25, 25, (60, 2))
        waves = rng.normal(0.0, 1.0 / 15.0, (2, 40))
        phases = rng.uniform(0.0, 2.0 * np.pi, 40)
        field = np.cos(np.vstack((place, region)) @ waves + phases).sum(axis=1) / np.sqrt(20.0)
        speed = mean * (1.0 + rng.uniform(0.01, 0.04) * field)
        d = rng.uniform(6.0, 9.0, 4)
        lag = 2.0 * d / speed[:4] + rng.uniform(-0.03, 0.03)
        caliper = d + rng.normal(0.0, 0.1, 4)
        found = calibrate_speed(caliper, lag, positions_mm=place, region_mm=region)
        if found.verdict == "good":
            off.append(found.speed_mm_per_us / speed[4:].mean() - 1.0)
            sigmas.append(found.share)
    assert len(off) > 150
    assert max(sigmas) <= GOOD_SHARE
    assert np.mean(np.abs(off) <= 2.0 * np.array(sigmas)) >= 0.9
    assert np.mean(np.abs(off) <= 3.0 * GOOD_SHARE) >= 0.99


def test_the_field_is_the_points_own_near_them_and_the_mean_far_away():
    place = np.array([[0.0, 0.0], [30.0, 0.0], [0.0, 30.0]])
    speeds = np.array([2.62, 2.72, 2.66])
    d = np.full(3, 8.0)
    exact = {"thickness_sigma_mm": 0.01, "lag_sigma_us": 0.001}
    exact["prior"] = replace(PUBLISHED, timing_us=0.0)
    found = calibrate_speed(d, 2 * d / speeds, positions_mm=place, **exact)
    at, sigma = speed_at(found, place)
    np.testing.assert_allclose(at, speeds, atol=0.01)
    assert sigma.max() < 0.01
    far, far_sigma = speed_at(found, [[500.0, 0.0]])
    assert far[0] == pytest.approx(found.speed_mm_per_us, abs=0.02)
    assert far_sigma[0] > PUBLISHED.local_sd_mm_per_us
    moved = calibrate_speed(d, 2 * d / speeds, positions_mm=place + 7.0, **exact)
    np.testing.assert_allclose(speed_at(moved, place + 7.0)[0], at, atol=1e-9)


def test_the_budget_adds_up_and_is_in_proportion_to_thickness():
    found = uncalibrated(SpeedPrior(patient_sd_mm_per_us=0.03 * NOMINAL))
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
