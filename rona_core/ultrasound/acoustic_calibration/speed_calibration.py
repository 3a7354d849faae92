"""Calibration of the sound speed in bone at a few places of known thickness.

The speed at a place is that of the literature, plus how this patient differs, plus how this place
differs from the rest of the patient. A caliper at reference points tells the last two apart as far
as it can; the estimate is the mean of a Gaussian process, so that one bad point is no more than
that. Speeds are mm/us, lags are two-way times from the outer to the inner boundary in us.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats, readonly
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US

PATIENT_SHARE = 0.03  # standard deviation of patients about the nominal speed
LOCAL_SHARE = 0.035  # of places about the mean of their patient; 0.02 to 0.05 in the literature
LOCAL_LENGTH_MM = 20.0  # over which the diploe's share, and with it the speed, changes
PLAUSIBLE_MM_PER_US = (2.1, 3.3)  # from trabecular bone alone to the stiffest cortex
CALIPER_MM = 0.1
TIMING_US = 0.03
MAX_THICKNESS_MM = 30.0
THIN_MM = 3.0  # below it a caliper's error is several per cent
FREEDOM = 4.0  # of Student's t: how much a single outlier counts
OUTLYING = 3.0  # standard deviations
ROUNDS = 25


@dataclass(frozen=True, slots=True)
class SpeedPrior:
    """Prior distribution of the speed: mean, spread between patients and between places."""

    mean_mm_per_us: float = NOMINAL_SPEED_MM_PER_US
    patient_sd_mm_per_us: float = PATIENT_SHARE * NOMINAL_SPEED_MM_PER_US
    local_sd_mm_per_us: float = LOCAL_SHARE * NOMINAL_SPEED_MM_PER_US
    local_length_mm: float = LOCAL_LENGTH_MM

    def __post_init__(self) -> None:
        low, high = PLAUSIBLE_MM_PER_US
        if not low <= self.mean_mm_per_us <= high:
            raise InvalidInputError(
                f"the speed in bone must be {low} to {high} mm/us: {self.mean_mm_per_us}"
            )
        spreads = (self.patient_sd_mm_per_us, self.local_sd_mm_per_us)
        if not (0 < min(spreads) and max(spreads) < 1.0 and 0 < self.local_length_mm < 1e3):
            raise InvalidInputError("spreads and the length of a speed must be positive and small")


PUBLISHED = SpeedPrior()


@dataclass(frozen=True, slots=True, eq=False)
class SpeedCalibration:
    """The mean speed of a patient, from reference points (n,); the prior where n is 0."""

    speed_mm_per_us: float
    sigma_mm_per_us: float  # of the patient's mean
    local_sd_mm_per_us: float  # of a place about it
    point_speeds_mm_per_us: Floats  # (n,) twice the thickness over the lag
    residuals_mm: Floats  # (n,) thickness by the mean speed less the caliper's
    strangeness: Floats  # (n,) residual in expected standard deviations
    weights: Floats  # (n,) 0 to 1: below 1/2 a point hardly counts
    positions_mm: Floats | None  # (n, 1 to 3)
    variances: Floats  # (n,) of the point speeds by caliper and timing, after weighting
    prior: SpeedPrior
    verdict: str  # "good", "weak" or "bad"
    reasons: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.weights)


def calibrate_speed(
    thickness_mm: ArrayLike,
    lag_us: ArrayLike,
    *,
    thickness_sigma_mm: float = CALIPER_MM,
    lag_sigma_us: float = TIMING_US,
    positions_mm: ArrayLike | None = None,
    prior: SpeedPrior = PUBLISHED,
) -> SpeedCalibration:
    """Return the mean speed of a patient, given places of known thickness.

    Args:
        thickness_mm: By caliper, along the probe's axis, (n,) with n >= 1.
        lag_us: By ultrasound at the same places (n,).
        thickness_sigma_mm: Standard deviation of the caliper.
        lag_sigma_us: Standard deviation of a lag.
        positions_mm: Of the places (n, 1 to 3); with them neighbours are correlated.
        prior: The distribution without the points.

    Raises:
        InvalidInputError: different numbers of values, or values that no bone has.
    """
    d, lag = _checked(thickness_mm, lag_us, thickness_sigma_mm, lag_sigma_us)
    positions = _places(positions_mm, len(d))
    speeds = 2.0 * d / lag
    measured = (2.0 * thickness_sigma_mm / lag) ** 2 + (speeds / lag * lag_sigma_us) ** 2
    local = _correlation(positions, positions, len(d), prior) * prior.local_sd_mm_per_us**2
    weights = np.ones(len(d))
    mean, variance, residuals = prior.mean_mm_per_us, 0.0, np.zeros(len(d))  # standardised
    for _ in range(ROUNDS if len(d) >= 3 else 1):
        mean, variance = _patient(speeds, local, measured, weights, prior)
        expected = np.sqrt(measured + prior.local_sd_mm_per_us**2)
        residuals = (speeds - mean) / expected
        if len(d) >= 3:  # weights of Student's t
            weights = np.minimum((FREEDOM + 1.0) / (FREEDOM + residuals**2), 1.0)
    verdict, reasons = _judged(d, speeds, residuals, weights, measured, prior)
    return SpeedCalibration(
        speed_mm_per_us=mean,
        sigma_mm_per_us=float(np.sqrt(variance)),
        local_sd_mm_per_us=prior.local_sd_mm_per_us,
        point_speeds_mm_per_us=readonly(speeds),
        residuals_mm=readonly(mean * lag / 2.0 - d),
        strangeness=readonly(residuals),
        weights=readonly(weights),
        positions_mm=None if positions is None else readonly(positions),
        variances=readonly(_inflated(measured, weights, prior)),
        prior=prior,
        verdict=verdict,
        reasons=reasons,
    )


def uncalibrated(prior: SpeedPrior = PUBLISHED) -> SpeedCalibration:
    """Return the prior as a calibration without any reference point."""
    none = readonly(np.zeros(0))
    return SpeedCalibration(
        prior.mean_mm_per_us,
        prior.patient_sd_mm_per_us,
        prior.local_sd_mm_per_us,
        none,
        none,
        none,
        none,
        None,
        none,
        prior,
        "weak",
        ("no reference point: the published mean, whatever the patient",),
    )


def speed_at(calibration: SpeedCalibration, positions_mm: ArrayLike) -> tuple[Floats, Floats]:
    """Return speed and its standard deviation (m,) at places (m, 1 to 3).

    Near a reference point it is that point's, far from all the patient's mean. Without positions of
    the reference points it is the mean everywhere.

    Raises:
        InvalidInputError: positions of another shape than those of the reference points.
    """
    places = _places(positions_mm, None)
    prior, measured = calibration.prior, calibration.positions_mm
    if places is None:
        raise InvalidInputError("positions must be given")
    total = prior.patient_sd_mm_per_us**2 + prior.local_sd_mm_per_us**2
    if measured is None or not len(calibration):
        sd = np.hypot(calibration.sigma_mm_per_us, calibration.local_sd_mm_per_us)
        n = len(places)
        return np.full(n, calibration.speed_mm_per_us), np.full(n, float(sd))
    if places.shape[1] != measured.shape[1]:
        raise InvalidInputError(
            f"positions must have {measured.shape[1]} coordinates, not {places.shape[1]}"
        )
    covariance = (
        _correlation(measured, measured, len(measured), prior) * prior.local_sd_mm_per_us**2
    )
    covariance = covariance + prior.patient_sd_mm_per_us**2 + np.diag(calibration.variances)
    cross = _correlation(places, measured, len(measured), prior) * prior.local_sd_mm_per_us**2
    cross = cross + prior.patient_sd_mm_per_us**2
    gain = np.linalg.solve(covariance, cross.T).T
    speed = prior.mean_mm_per_us + gain @ (
        calibration.point_speeds_mm_per_us - prior.mean_mm_per_us
    )
    variance = total - np.einsum("mn,mn->m", gain, cross)
    return speed, np.sqrt(np.maximum(variance, 0.0))


def _patient(
    speeds: Floats, local: Floats, measured: Floats, weights: Floats, prior: SpeedPrior
) -> tuple[float, float]:
    """Return mean and variance of the patient's mean speed, given the points and the prior."""
    covariance = local + np.diag(_inflated(measured, weights, prior))
    ones = np.ones(len(speeds))
    solved = np.linalg.solve(covariance, np.column_stack((ones, speeds)))
    precision = float(ones @ solved[:, 0]) + prior.patient_sd_mm_per_us**-2
    weighted = float(ones @ solved[:, 1])
    weighted += prior.mean_mm_per_us * prior.patient_sd_mm_per_us**-2
    return weighted / precision, 1.0 / precision


def _inflated(measured: Floats, weights: Floats, prior: SpeedPrior) -> Floats:
    """Return the variances (n,) with which outliers count less."""
    total = measured + prior.local_sd_mm_per_us**2
    return measured + total * (1.0 / weights - 1.0)


def _correlation(a: Floats | None, b: Floats | None, n: int, prior: SpeedPrior) -> Floats:
    if a is None or b is None:
        return np.eye(n)
    away = np.linalg.norm(a[:, None, :] - b[None, :, :], axis=2) / prior.local_length_mm
    return np.exp(-0.5 * away**2)


def _judged(
    d: Floats,
    speeds: Floats,
    residuals: Floats,
    weights: Floats,
    measured: Floats,
    prior: SpeedPrior,
) -> tuple[str, tuple[str, ...]]:
    low, high = PLAUSIBLE_MM_PER_US
    bad: list[str] = []
    weak: list[str] = []
    spread = np.sqrt(measured + prior.local_sd_mm_per_us**2 + prior.patient_sd_mm_per_us**2)
    off = np.abs(speeds - prior.mean_mm_per_us) / spread
    impossible = (speeds < low - 2 * np.sqrt(measured)) | (speeds > high + 2 * np.sqrt(measured))
    if 2 * int(impossible.sum()) >= len(d):
        bad.append(
            f"point speeds of {speeds.min():.2f} to {speeds.max():.2f} mm/us are not those of "
            "bone: another echo, or another place than the caliper's"
        )
    if len(d) < 3 and off.max() > OUTLYING:
        bad.append(f"a point is {off.max():.1f} standard deviations off what is published")
    outliers = np.flatnonzero(np.abs(residuals) > OUTLYING) if len(d) >= 3 else np.zeros(0)
    if len(outliers):
        names = ", ".join(str(int(i) + 1) for i in outliers)
        weak.append(f"point {names} does not agree with the others: measure it again")
    if len(d) >= 3 and weights.sum() < 0.6 * len(d):
        bad.append("the points do not agree with each other")
    if len(d) < 3:
        weak.append(f"{len(d)} of 3 reference points")
    if float(np.median(d)) < THIN_MM:
        weak.append(f"the points are thin ({np.median(d):.1f} mm): choose thicker places")
    verdict = "bad" if bad else "weak" if weak else "good"
    return verdict, (*bad, *weak)


def _checked(
    thickness_mm: ArrayLike, lag_us: ArrayLike, caliper_mm: float, timing_us: float
) -> tuple[Floats, Floats]:
    d = np.atleast_1d(as_floats(thickness_mm, name="thickness_mm"))
    lag = np.atleast_1d(as_floats(lag_us, name="lag_us"))
    if d.ndim != 1 or d.shape != lag.shape or not len(d):
        raise InvalidInputError(
            f"each reference point needs a thickness and a lag: {d.shape} and {lag.shape}"
        )
    if not (0 < d.min() and d.max() <= MAX_THICKNESS_MM and 0 < lag.min()):
        raise InvalidInputError(f"thicknesses must be 0 to {MAX_THICKNESS_MM:g} mm, lags above 0")
    if not (0 < caliper_mm <= 2.0 and 0 <= timing_us <= 2.0):
        raise InvalidInputError("standard deviations must be positive, in mm and us")
    if np.abs(2.0 * d / lag / NOMINAL_SPEED_MM_PER_US - 1.0).min() > 0.6:
        raise InvalidInputError(
            f"2 x thickness / lag is {2 * d[0] / lag[0]:.3g} mm/us: lags are two-way times in us"
        )
    return d, lag


def _places(positions_mm: ArrayLike | None, n: int | None) -> Floats | None:
    if positions_mm is None:
        return None
    p = as_floats(positions_mm, name="positions_mm")
    p = p[:, None] if p.ndim == 1 else p
    if p.ndim != 2 or not 1 <= p.shape[1] <= 3 or (n is not None and len(p) != n):
        raise InvalidInputError(f"positions must have shape (n, 1 to 3), not {p.shape}")
    return p
