"""How sure a speed of sound is where studies differ by more than patients of one study do."""

import numpy as np
import pytest

from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    PUBLISHED,
    SpeedPrior,
    calibrate_speed,
    uncalibrated,
)
from rona_core.ultrasound.acoustic_calibration.speed_uncertainty import (
    STUDIES_SHARE,
    speed_uncertainty,
)

HERE = np.array([[0.0, 0.0]])
FAR = np.array([[200.0, 0.0]])
NOMINAL = PUBLISHED.mean_mm_per_us


def test_studies_that_differ_by_13_percent_are_evenly_spread():
    assert pytest.approx(np.std(np.linspace(0.0, 0.13, 100_001)), rel=1e-4) == STUDIES_SHARE


def test_without_a_reference_point_it_is_what_studies_and_places_differ_by():
    shared, place = speed_uncertainty(uncalibrated(), np.vstack((HERE, FAR)))
    np.testing.assert_allclose(shared, STUDIES_SHARE, rtol=1e-9)
    np.testing.assert_allclose(place, PUBLISHED.local_sd_mm_per_us / NOMINAL, rtol=1e-9)


def test_a_prior_wider_than_the_studies_is_kept():
    wide = SpeedPrior(patient_sd_mm_per_us=0.08 * NOMINAL)
    assert speed_uncertainty(uncalibrated(wide), HERE)[0][0] == pytest.approx(0.08)


@pytest.mark.parametrize("n", [1, 3, 6])
def test_it_is_the_error_of_the_mean_over_patients_of_all_studies(n):
    """Patients from between the studies, their means estimated with the narrower prior."""
    rng = np.random.default_rng(n)
    errors, stated = [], []
    far_apart = 100.0 * np.column_stack((np.arange(n), np.zeros(n)))
    for _ in range(3000):
        patient = NOMINAL * (1.0 + STUDIES_SHARE * rng.standard_normal())
        speeds = patient + PUBLISHED.local_sd_mm_per_us * rng.standard_normal(n)
        d = np.full(n, 7.0)
        lags = 2.0 * d / speeds
        caliper = d + rng.normal(0.0, 0.1, n)
        found = calibrate_speed(caliper, lags, lag_sigma_us=0.001, positions_mm=far_apart)
        errors.append(found.speed_mm_per_us / patient - 1.0)
        stated.append(speed_uncertainty(found, np.array([[-900.0, 0.0]]))[0][0])
    assert np.sqrt(np.mean(np.square(stated))) == pytest.approx(np.std(errors), rel=0.06)


def test_next_to_a_reference_point_little_is_left_of_it():
    found = calibrate_speed(
        [7.0], [14.0 / 2.5], thickness_sigma_mm=0.01, lag_sigma_us=0.001, positions_mm=HERE
    )
    near, far = (np.hypot(*speed_uncertainty(found, at))[0] for at in (HERE, FAR))
    assert near < 0.005 < 0.04 < far
