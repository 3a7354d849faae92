"""Thickness with an unknown sound speed: as published, and after one, three and five calipers.

Assumed: patients differ by 3 % (SD) about the nominal speed; places differ from their patient by 2
to 5 % (uniform over patients), smoothly over 10 to 30 mm; calottes are 6 mm +- 1.5 thick; a
caliper errs by 0.1 mm; the time of flight by 0.05 mm, a rough skull's floor at 2.25 MHz. The
calibration knows none of these draws, and takes 3.5 % and 20 mm for all.
"""

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms
from benchmarks.reference.thickness_budget import thickness_budget
from rona_core.app.declarations.figures import limit_of
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    calibrate_speed,
    speed_at,
    uncalibrated,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import PUBLISHED
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US

PATIENTS = 2000
PLACES = 40  # measured in each
RADIUS_MM = 25.0  # of the scanned disc
RING_MM = 14.0  # on which reference points lie
PATIENT_SHARE, LOCAL_SHARES, LENGTHS_MM = 0.03, (0.02, 0.05), (10.0, 30.0)
THICKNESS_MM, THICKNESS_SD_MM = 6.0, 1.5
CALIPER_MM, DETECTION_MM = 0.1, 0.05
WAYS = ("mean", "field")


def run(progress: Progress) -> list[Metric]:
    """Return RMS errors of the thickness over patients and places."""
    metrics: list[Metric] = []
    for points in (0, 1, 3, 5):
        progress(f"{PATIENTS} patients, {points} reference points")
        errors = {way: np.zeros((PATIENTS, PLACES)) for way in WAYS}
        expected = np.zeros((PATIENTS, PLACES))
        for patient in range(PATIENTS):
            rng = np.random.default_rng([7, patient])
            known, places, true, lag = _patient(rng, points)
            errors["mean"][patient] = known.speed_mm_per_us * lag / 2.0 - true
            speed, _ = speed_at(known, places)
            errors["field"][patient] = speed * lag / 2.0 - true
            timing_us = 2.0 * DETECTION_MM / known.speed_mm_per_us
            expected[patient] = thickness_budget(true, known, lag_sigma_us=timing_us).sigma_mm
        goal = {0: limit_of("thickness_sigma_predicted_mm"), 3: 0.20}.get(points)
        for way in WAYS if points else WAYS[:1]:
            rms = _rms(errors[way])
            aim = goal if way == "field" or not points else None
            name = f"thickness_rms_mm, {points} points, {way}"
            metrics.append(Metric(name, rms, "mm", "lower", aim, "paper", 0.5))
        share = _rms(errors["mean"]) / _rms(expected)
        metrics.append(Metric(f"error_over_budget, {points} points", share, "", "lower", 1.15))
    thickness, lag = np.full(3, 6.0), np.full(3, 12.0 / NOMINAL_SPEED_MM_PER_US)
    time = cpu_ms(lambda: calibrate_speed(thickness, lag))
    metrics.append(Metric("calibration_cpu_ms", time, "ms", "lower", 20.0))
    return metrics


def _patient(
    rng: np.random.Generator, points: int
) -> tuple[SpeedCalibration, Floats, Floats, Floats]:
    """Return a calibration, places (m, 2), their true thicknesses and their measured lags."""
    angle = 2.0 * np.pi * (np.arange(points) / max(points, 1) + rng.random())
    references = RING_MM * np.column_stack((np.cos(angle), np.sin(angle)))
    radius = RADIUS_MM * np.sqrt(rng.random(PLACES))
    turn = 2.0 * np.pi * rng.random(PLACES)
    places = np.column_stack((radius * np.cos(turn), radius * np.sin(turn)))
    everywhere = np.concatenate((references, places))
    mean = NOMINAL_SPEED_MM_PER_US * (1.0 + PATIENT_SHARE * rng.standard_normal())
    speed = mean * (1.0 + rng.uniform(*LOCAL_SHARES) * _smooth(everywhere, rng))
    true = np.clip(rng.normal(THICKNESS_MM, THICKNESS_SD_MM, len(everywhere)), 2.5, 12.0)
    error = rng.normal(0.0, DETECTION_MM, len(everywhere))
    lag = 2.0 * (true + error) / speed
    if not points:
        return uncalibrated(), places, true, lag
    caliper = true[:points] + rng.normal(0.0, CALIPER_MM, points)
    timing_us = 2.0 * DETECTION_MM / PUBLISHED.mean_mm_per_us
    known = calibrate_speed(
        caliper,
        lag[:points],
        thickness_sigma_mm=CALIPER_MM,
        lag_sigma_us=timing_us,
        positions_mm=references,
    )
    return known, places, true[points:], lag[points:]


def _smooth(points: Floats, rng: np.random.Generator) -> Floats:
    """Return a smooth random field of unit variance at points (n, 2): a sum of waves."""
    waves = rng.normal(0.0, 1.0 / rng.uniform(*LENGTHS_MM), (2, 60))
    field = np.cos(points @ waves + rng.uniform(0.0, 2.0 * np.pi, 60)).sum(axis=1)
    return field / np.sqrt(30.0)


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean()))
