"""Calibration of the sound speed in bone at a few places of known thickness.

A caliper at reference points measures how this patient differs from the published mean, and as far
as it can how places differ from each other (``speed_field``), so that one bad point is no more than
that. Speeds are mm/us, lags are two-way times from the outer to the inner boundary in us.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats, readonly
from rona_core.ultrasound.acoustic_calibration.point_weights import LEAST_POINTS, weigh_points
from rona_core.ultrasound.acoustic_calibration.speed_field import (
    PointSpeeds,
    SpeedField,
    field_covariance,
    speed_field,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import (
    PLAUSIBLE_MM_PER_US,
    PUBLISHED,
    TIMING_US,
    SpeedPrior,
)
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US

CALIPER_MM = 0.1
MAX_THICKNESS_MM = 30.0
THIN_MM = 3.0  # below it a caliper's error is several per cent
OUTLYING = 3.0  # standard deviations
# A speed is good that is known to 1.5 %: on 6.5 mm of bone no more than a caliper's own 0.1 mm.
GOOD_SHARE = 0.015
DOUBTED_US = 3.0 * TIMING_US  # what lags share is more than a usual error of timing


@dataclass(frozen=True, slots=True, eq=False)
class SpeedCalibration:
    """The mean speed over a region, from reference points (n,); the prior where n is 0.

    Files of before have the mean of the patient in its place, and no lags.
    """

    speed_mm_per_us: float
    sigma_mm_per_us: float  # of that mean
    local_sd_mm_per_us: float  # of places about their patient
    point_speeds_mm_per_us: Floats  # (n,) twice the thickness over the lag
    residuals_mm: Floats  # (n,) thickness by the mean speed less the caliper's
    strangeness: Floats  # (n,) residual in expected standard deviations
    weights: Floats  # (n,) 0 to 1: below 1/2 a point hardly counts
    positions_mm: Floats | None  # (n, 1 to 3)
    variances: Floats  # (n,) of the point speeds by caliper and timing, after weighting
    prior: SpeedPrior
    verdict: str  # "good", "weak" or "bad"
    reasons: tuple[str, ...]
    lags_us: tuple[float, ...] = field(default=(), metadata={"omit_empty": True})  # n of them

    def __len__(self) -> int:
        return len(self.weights)

    @property
    def share(self) -> float:
        """Standard deviation of the mean speed over that speed."""
        return self.sigma_mm_per_us / self.speed_mm_per_us

    def local_prior(self) -> SpeedPrior:
        """Return the prior with places as far apart as the points say."""
        return replace(self.prior, local_sd_mm_per_us=self.local_sd_mm_per_us)


def calibrate_speed(
    thickness_mm: ArrayLike,
    lag_us: ArrayLike,
    *,
    thickness_sigma_mm: ArrayLike = CALIPER_MM,
    lag_sigma_us: ArrayLike = TIMING_US,
    positions_mm: ArrayLike | None = None,
    region_mm: ArrayLike | None = None,
    prior: SpeedPrior = PUBLISHED,
) -> SpeedCalibration:
    """Return the mean speed over a region of a patient, given places of known thickness.

    Args:
        thickness_mm: By caliper, along the probe's axis, (n,) with n >= 1.
        lag_us: By ultrasound at the same places (n,).
        thickness_sigma_mm: Standard deviations of the caliper, one or (n,).
        lag_sigma_us: Standard deviations of the lags, each for itself, one or (n,).
        positions_mm: Of the places (n, 1 to 3); with them neighbours are correlated.
        region_mm: Places (m, 1 to 3) of the bone that the mean is meant for, with the same
            coordinates; without them it is the mean of the patient.
        prior: The distribution without the points.

    Raises:
        InvalidInputError: different numbers of values, or values that no bone has.
    """
    d, lag = _checked(thickness_mm, lag_us)
    caliper = _sigmas(thickness_sigma_mm, len(d), 1e-9)
    timing = _sigmas(lag_sigma_us, len(d), 0.0)
    positions = None if positions_mm is None else _places(positions_mm, len(d))
    region = None if region_mm is None else _places(region_mm, None)
    speeds = 2.0 * d / lag
    measured = (2.0 * caliper / lag) ** 2 + (speeds / lag * timing) ** 2
    common = speeds / lag * prior.timing_us
    fit = weigh_points(speeds, measured, common, positions, prior)
    whole = speed_field(fit.points, fit.prior, None, region)
    made = SpeedCalibration(
        speed_mm_per_us=whole.region_mean,
        sigma_mm_per_us=float(np.sqrt(whole.region_variance)),
        local_sd_mm_per_us=fit.prior.local_sd_mm_per_us,
        point_speeds_mm_per_us=readonly(speeds),
        residuals_mm=readonly(whole.region_mean * lag / 2.0 - d),
        strangeness=readonly(fit.residuals),
        weights=readonly(fit.weights),
        positions_mm=None if positions is None else readonly(positions),
        variances=readonly(fit.variances),
        prior=prior,
        verdict="good",
        reasons=(),
        lags_us=tuple(float(value) for value in lag),
    )
    verdict, reasons = _judged(made, d, np.sqrt(measured + common**2))
    return replace(made, verdict=verdict, reasons=reasons)


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
    found = field_at(calibration, as_places(positions_mm, calibration), None)
    return found.mean, np.sqrt(found.variance)


def field_at(
    calibration: SpeedCalibration, places_mm: Floats, region_mm: Floats | None
) -> SpeedField:
    """Return the speed at places (m, k), given the points of a calibration.

    ``region_mm`` (r, k) is what the mean is wanted over; None: the patient.
    """
    return speed_field(_points(calibration), calibration.local_prior(), places_mm, region_mm)


def speed_covariance(calibration: SpeedCalibration, positions_mm: ArrayLike) -> Floats:
    """Return the covariance (m, m) of the speed at places (m, 1 to 3).

    Raises:
        InvalidInputError: positions of another shape than those of the reference points.
    """
    places = as_places(positions_mm, calibration)
    return field_covariance(_points(calibration), calibration.local_prior(), places)


def _points(calibration: SpeedCalibration) -> PointSpeeds:
    speeds, covariance = calibration.point_speeds_mm_per_us, np.diag(calibration.variances)
    if calibration.lags_us:
        common = speeds / np.array(calibration.lags_us) * calibration.prior.timing_us
        covariance = covariance + np.outer(common, common)
    return PointSpeeds(speeds, covariance, calibration.positions_mm)


def as_places(positions_mm: ArrayLike, calibration: SpeedCalibration) -> Floats:
    """Return places as an array (m, k) with the coordinates of the reference points.

    Raises:
        InvalidInputError: another shape.
    """
    places = _places(positions_mm, None)
    known = calibration.positions_mm
    if known is not None and places.shape[1] != known.shape[1]:
        raise InvalidInputError(
            f"positions must have {known.shape[1]} coordinates, not {places.shape[1]}"
        )
    return places


def _judged(made: SpeedCalibration, d: Floats, measured: Floats) -> tuple[str, tuple[str, ...]]:
    """Return verdict and reasons, given thicknesses (n,) and sigmas of measuring a speed (n,)."""
    low, high = PLAUSIBLE_MM_PER_US
    prior, speeds = made.prior, made.point_speeds_mm_per_us
    bad: list[str] = []
    weak: list[str] = []
    spread = np.hypot(prior.local_sd_mm_per_us, prior.patient_sd_mm_per_us)
    off = np.abs(speeds - prior.mean_mm_per_us) / np.hypot(measured, spread)
    impossible = (speeds < low - 2 * measured) | (speeds > high + 2 * measured)
    if 2 * int((impossible | (off > OUTLYING)).sum()) >= len(d):
        bad.append(
            f"point speeds of {speeds.min():.2f} to {speeds.max():.2f} mm/us are not those of "
            "bone: another echo, or another place than the caliper's. Measure again elsewhere"
        )
    outliers = np.flatnonzero(np.abs(made.strangeness) > OUTLYING)
    if len(outliers) and len(d) >= LEAST_POINTS:
        names = ", ".join(str(int(i) + 1) for i in outliers)
        weak.append(f"point {names} does not agree with the others: measure it again")
    if len(d) >= LEAST_POINTS and made.weights.sum() < 0.6 * len(d):
        bad.append("the points do not agree with each other: measure them again")
    if len(d) < LEAST_POINTS:
        weak.append(f"{len(d)} of {LEAST_POINTS} reference points")
    if float(np.median(d)) < THIN_MM:
        weak.append(f"the points are thin ({np.median(d):.1f} mm): choose thicker places")
    elif made.share > GOOD_SHARE and prior.timing_us > DOUBTED_US:
        weak.append(
            f"known to {100 * made.share:.1f} % only: all echoes may be early or late together, as "
            "they are less likely than usual, or the upright pass hears none. Look at their "
            "A-scans, or scan another region"
        )
    elif made.share > GOOD_SHARE:
        weak.append(
            f"known to {100 * made.share:.1f} % only, {100 * GOOD_SHARE:g} % would be good: add "
            "points, at thick places far from these"
        )
    return "bad" if bad else "weak" if weak else "good", (*bad, *weak)


def _checked(thickness_mm: ArrayLike, lag_us: ArrayLike) -> tuple[Floats, Floats]:
    d = np.atleast_1d(as_floats(thickness_mm, name="thickness_mm"))
    lag = np.atleast_1d(as_floats(lag_us, name="lag_us"))
    if d.ndim != 1 or d.shape != lag.shape or not len(d):
        raise InvalidInputError(
            f"each reference point needs a thickness and a lag: {d.shape} and {lag.shape}"
        )
    if not (0 < d.min() and d.max() <= MAX_THICKNESS_MM and 0 < lag.min()):
        raise InvalidInputError(f"thicknesses must be 0 to {MAX_THICKNESS_MM:g} mm, lags above 0")
    if np.abs(2.0 * d / lag / NOMINAL_SPEED_MM_PER_US - 1.0).min() > 0.6:
        raise InvalidInputError(
            f"2 x thickness / lag is {2 * d[0] / lag[0]:.3g} mm/us: lags are two-way times in us"
        )
    return d, lag


def _sigmas(values: ArrayLike, n: int, least: float) -> Floats:
    """Return standard deviations (n,), given one for all or each of them."""
    sigmas = as_floats(values, name="sigma")
    if sigmas.shape not in ((), (1,), (n,)) or not (least <= sigmas.min() and sigmas.max() <= 2.0):
        raise InvalidInputError("standard deviations must be positive, in mm and us, one or each")
    return np.broadcast_to(sigmas, (n,))


def _places(positions_mm: ArrayLike, n: int | None) -> Floats:
    p = as_floats(positions_mm, name="positions_mm")
    p = p[:, None] if p.ndim == 1 else p
    if p.ndim != 2 or not 1 <= p.shape[1] <= 3 or (n is not None and len(p) != n):
        raise InvalidInputError(f"positions must have shape (n, 1 to 3), not {p.shape}")
    return p


def speed_uncertainty(
    calibration: SpeedCalibration, places_mm: ArrayLike, region_mm: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """Return the relative standard deviations (n,) of the speed at places (n, 1 to 3), two parts.

    The first all places share: that of the mean over the region. The second is that of the place
    against that mean.

    Args:
        calibration: Of the speed; the prior alone, where nothing was calibrated.
        places_mm: In the frame of the reference points.
        region_mm: Places (m, 1 to 3) that what is shared is meant for; without, those asked for.

    Raises:
        InvalidInputError: places of another shape than those of the reference points.
    """
    places = as_places(places_mm, calibration)
    region = places if region_mm is None else as_places(region_mm, calibration)
    field = field_at(calibration, places, region)
    shared = np.sqrt(field.region_variance) / field.mean
    return shared, np.sqrt(field.own_variance) / field.mean
