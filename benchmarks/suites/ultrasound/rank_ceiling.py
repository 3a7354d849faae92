"""Why sigmas of the thickness of A-scans hardly tell which are wrong: their rank, step by step.

Rank is the correlation (Spearman) of the local sigma and the size of the local error within a
patient, as in the case ``thickness`` of ``honesty``. Errors drawn as they are claimed have the
highest; then times of flight and speeds of places are drawn as they are, one after the other. The
last is the best order that was found in what the program observes of an A-scan: ridge regression
of the logarithm of the error, fitted to other patients. The seeds were tuned with, and observables
and penalty were chosen on them: this explains, it judges nothing, and no figure has a goal.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.metric import Metric, Progress
from benchmarks.suites.honesty.judged import over_draws, rank_correlation
from benchmarks.suites.honesty.thickness import (
    LEAST_SURE,
    POINTS,
    Patient,
    calibrated,
    surveyed,
    thickness_errors,
)
from benchmarks.suites.ultrasound.observed_order import best_ranks, observables
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    speed_at,
    speed_covariance,
    uncalibrated,
)

SEEDS = range(45_000, 45_096)
NORMAL = "normal errors of these sigmas"
FIELD = "speeds drawn as the field that is claimed"
SHAPE = "and times of flight as others of like sigma have them"
SPEEDS = "and speeds as they are"
OWN = "and times of flight as this patient has them, shuffled among like sigmas"
AS_IS = "as it is"
BEST, GAIN = "best order of what is observed", "gain of that order"
DRAWS = 8  # of the errors of a patient
JITTER = 1e-9  # (mm/us)^2, for the root of a covariance
CLASSES = 6  # of the sigma of time, each with as many A-scans


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
    """Sure A-scans (n,) of one patient that took the right echo; errors are found minus true.

    The local error is made of that of the time of flight and that of the speed of the place.
    """

    local_mm: Floats
    timing_mm: Floats  # of the time of flight
    local_sigma_mm: Floats
    timing_sigma_mm: Floats
    claimed_mm: Floats  # (draws, n) errors by the speed of the place, as its field claims them
    observed: Floats  # (n, k) logarithms of observables


def run(progress: Progress) -> list[Metric]:
    """Return the mean rank correlation over patients, step by step, for each number of points."""
    found: dict[int, list[Scans]] = {points: [] for points in POINTS}
    for seed in SEEDS:
        progress(f"seed {seed}")
        try:
            patient = surveyed(seed)
        except RonaError as error:
            progress(f"seed {seed}: refused: {error}")
            continue
        if int(patient.right.sum()) < LEAST_SURE:
            progress(f"seed {seed}: hardly an A-scan is sure of its inner boundary")
            continue
        for points in POINTS:
            known = calibrated(patient, points) if points else uncalibrated()
            found[points].append(scans_of(patient, known))
    return [metric for points, group in found.items() for metric in figures(points, group)]


def figures(points: int, patients: Sequence[Scans]) -> list[Metric]:
    """Return the figures for one number of reference points."""
    name = f"{points} reference points"
    ranks = steps(patients)
    ranks[BEST] = best_ranks([p.observed for p in patients], [p.local_mm for p in patients])
    gain = over_draws(np.subtract(ranks[BEST], ranks[AS_IS]).tolist())
    return [
        Metric(f"patients, {name}", float(len(patients)), "", "higher"),
        *(
            Metric(f"rank, {step}, {name}", over_draws(found).value, "", "higher")
            for step, found in ranks.items()
        ),
        Metric(f"{GAIN}, {name}", gain.value, "", "lower"),
        Metric(f"{GAIN}, {name}, 95 % of draws from", gain.low, "", "lower"),
        Metric(f"{GAIN}, {name}, 95 % of draws to", gain.high, "", "lower"),
    ]


def scans_of(patient: Patient, known: SpeedCalibration) -> Scans:
    """Return errors, sigmas and observables of one patient at a calibrated speed."""
    detection, right = patient.detection, patient.right
    rows = np.flatnonzero(detection.inner_ok)[right]
    places, true = patient.places_base[rows], patient.speed_mm_per_us[rows]
    found, speed = thickness_errors(patient, known), speed_at(known, places)[0]
    lag_us = detection.thickness_mm[rows] / detection.sound_speed_mm_per_us
    field = speed_covariance(known, places) + JITTER * np.eye(len(rows))
    normal = np.random.default_rng(patient.seed).normal(size=(DRAWS, len(rows)))
    share = normal @ np.linalg.cholesky(field).T / speed
    return Scans(
        local_mm=found.local_mm,
        timing_mm=lag_us * true - patient.thickness_mm[rows],
        local_sigma_mm=found.local_sigma_mm,
        timing_sigma_mm=detection.thickness_sigma_mm[rows],
        claimed_mm=lag_us * speed * (share - share.mean(axis=1, keepdims=True)),
        observed=observables(patient, rows, found.local_sigma_mm),
    )


def steps(patients: Sequence[Scans]) -> dict[str, list[float]]:
    """Return the rank correlation of each patient, from errors as claimed to those that are."""
    found: dict[str, list[float]] = {
        step: [] for step in (NORMAL, FIELD, SHAPE, SPEEDS, OWN, AS_IS)
    }
    random = np.random.default_rng(0)
    others, own = shaped_timing(patients), shaped_timing(patients, own=True)
    for one, shaped, shuffled in zip(patients, others, own, strict=True):
        normal = random.normal(size=shaped.shape)
        speed_mm = one.local_mm - one.timing_mm
        errors = {
            NORMAL: normal * one.local_sigma_mm,
            FIELD: _centred(one.claimed_mm + normal * one.timing_sigma_mm),
            SHAPE: _centred(one.claimed_mm + shaped),
            SPEEDS: _centred(speed_mm + shaped),
            OWN: _centred(speed_mm + shuffled),
            AS_IS: one.local_mm[None],
        }
        for step, drawn in errors.items():
            ranks = [rank_correlation(row, one.local_sigma_mm) for row in drawn]
            found[step].append(float(np.mean(ranks)))
    return found


def shaped_timing(patients: Sequence[Scans], *, own: bool = False) -> list[Floats]:
    """Return errors (draws, n) of times of flight, in mm, that those of other patients have.

    Each is the ratio of error and sigma of an A-scan of the same class of sigma, times the sigma.

    Args:
        patients: At least two, or there is nobody to draw from.
        own: Draw from the patient's own A-scans in place of those of others.
    """
    if not patients:
        return []
    sigmas = np.concatenate([one.timing_sigma_mm for one in patients])
    ratios = np.concatenate([one.timing_mm for one in patients]) / sigmas
    whose = np.repeat(np.arange(len(patients)), [len(one.timing_mm) for one in patients])
    edges = np.quantile(sigmas, np.arange(1, CLASSES) / CLASSES)
    classes = np.searchsorted(edges, sigmas)
    random, found = np.random.default_rng(1), []
    for number, one in enumerate(patients):
        drawn = np.zeros((DRAWS, len(one.timing_mm)))
        for k in range(CLASSES):
            mine = classes[whose == number] == k
            pool = ratios[((whose == number) == own) & (classes == k)]
            if len(pool):
                drawn[:, mine] = random.choice(pool, size=(DRAWS, int(mine.sum())))
        found.append(drawn * one.timing_sigma_mm)
    return found


def _centred(errors: Floats) -> Floats:
    return errors - errors.mean(axis=-1, keepdims=True)
