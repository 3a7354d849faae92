"""How sure a speed of sound is: what all places share, and what each has of its own."""

import numpy as np
import pytest

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    calibrate_speed,
    speed_at,
    speed_covariance,
    speed_uncertainty,
    uncalibrated,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import (
    LOCAL_SHARE,
    PATIENTS_SHARE,
    PUBLISHED,
    STUDIES_SHARE,
    WITHIN_STUDY_SHARE,
    SpeedPrior,
)

HERE = np.array([[0.0, 0.0]])
FAR = np.array([[200.0, 0.0]])
EVERYWHERE = 300.0 * np.arange(2000.0)[:, None]
NOMINAL = PUBLISHED.mean_mm_per_us


def _drawn(least: float, most: float) -> Floats:
    """Return variances of which the range of deviations holds all but what is beyond 2 of them."""
    low, high = np.log((least, most))
    logs = np.random.default_rng(0).normal((low + high) / 2.0, (high - low) / 4.0, 20_000)
    return np.exp(2.0 * logs)


def test_what_pieces_of_bone_differ_by_is_patients_and_places_together():
    pieces = np.sqrt(np.mean(_drawn(0.014, 0.07)))
    assert np.hypot(WITHIN_STUDY_SHARE, LOCAL_SHARE) == pytest.approx(pieces, rel=0.02)


def test_the_published_prior_is_as_wide_as_what_studies_differ_by():
    assert pytest.approx(np.std((2.55, 2.69, 2.71, 2.82), ddof=1) / 2.6925) == STUDIES_SHARE
    assert PATIENTS_SHARE > STUDIES_SHARE  # patients of one study differ too
    ends = PUBLISHED.mean_mm_per_us + 2.0 * PUBLISHED.patient_sd_mm_per_us * np.array((-1.0, 1.0))
    assert ends[0] < 2.45  # Pichardo 2011 at 1 MHz
    assert ends[1] > 2.85  # White 2006


def test_without_a_reference_point_it_is_what_patients_and_places_differ_by():
    shared, place = speed_uncertainty(uncalibrated(), EVERYWHERE)
    np.testing.assert_allclose(shared, PATIENTS_SHARE, rtol=1e-3)
    np.testing.assert_allclose(place, PUBLISHED.local_sd_mm_per_us / NOMINAL, rtol=1e-2)


def test_both_parts_of_one_place_are_all_that_is_not_known_of_it():
    found = calibrate_speed([7.0, 6.0], [5.2, 4.5], positions_mm=np.vstack((HERE, HERE + 30.0)))
    places = np.random.default_rng(0).uniform(-20.0, 40.0, (60, 2))
    speed, sigma = speed_at(found, places)
    for i in range(3):  # with itself for a region a place has nothing of its own
        shared, own = speed_uncertainty(found, places[[i]])
        assert own[0] == pytest.approx(0.0, abs=1e-6)
        assert shared[0] == pytest.approx(sigma[i] / speed[i])


def test_it_is_the_spread_of_patients_drawn_from_the_field():
    """Mean over a region and deviation from it, of fields drawn from the posterior."""
    rng = np.random.default_rng(3)
    points = np.array([[0.0, 0.0], [15.0, 5.0], [-10.0, 12.0]])
    found = calibrate_speed([7.0, 6.0, 8.0], [5.2, 4.5, 6.0], positions_mm=points)
    places = rng.uniform(-25.0, 25.0, (80, 2))
    shared, own = speed_uncertainty(found, places)
    drawn = rng.multivariate_normal(np.zeros(80), speed_covariance(found, places), 20000)
    speed = speed_at(found, places)[0]
    means = drawn.mean(axis=1)
    np.testing.assert_allclose(shared * speed, means.std(), rtol=0.03)
    np.testing.assert_allclose(own * speed, (drawn - means[:, None]).std(axis=0), rtol=0.05)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("n", [1, 3, 6])
def test_it_is_the_error_of_the_mean_over_patients_of_all_studies(n):
    rng = np.random.default_rng(n)
    errors, stated = [], []
    far_apart = 100.0 * np.column_stack((np.arange(n), np.zeros(n)))
    for _ in range(600):
        patient = NOMINAL * (1.0 + PATIENTS_SHARE * rng.standard_normal())
        speeds = patient + PUBLISHED.local_sd_mm_per_us * rng.standard_normal(n)
        d = np.full(n, 7.0)
        lags = 2.0 * d / speeds + PUBLISHED.timing_us * rng.standard_normal()
        caliper = d + rng.normal(0.0, 0.1, n)
        found = calibrate_speed(caliper, lags, lag_sigma_us=0.001, positions_mm=far_apart)
        errors.append(found.speed_mm_per_us / patient - 1.0)
        stated.append(found.share)
    assert np.sqrt(np.mean(np.square(stated))) == pytest.approx(np.std(errors), rel=0.12)


def test_next_to_a_reference_point_little_is_left_of_it():
    found = calibrate_speed(
        [7.0],
        [14.0 / 2.5],
        thickness_sigma_mm=0.01,
        lag_sigma_us=0.001,
        positions_mm=HERE,
        prior=SpeedPrior(),
    )
    near, far = (np.hypot(*speed_uncertainty(found, at))[0] for at in (HERE, FAR))
    assert near < 0.005 < 0.04 < far
