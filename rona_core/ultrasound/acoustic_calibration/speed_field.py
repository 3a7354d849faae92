"""Speed of sound over the bone as a Gaussian process, given reference points (Rasmussen 2006).

The speed at a place is the prior's mean, plus how this patient differs, plus how the place differs
from the rest of the patient. Speeds are mm/us, places mm in any frame that stands still.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.acoustic_calibration.speed_prior import SpeedPrior

MOST_OF_REGION = 200  # places that stand for a region
QUANTILES = np.linspace(-2.0, 2.0, 9)  # of how much places differ, in standard deviations


@dataclass(frozen=True, slots=True, eq=False)
class PointSpeeds:
    """Speeds measured at reference points (n,); n may be 0."""

    speeds: Floats  # (n,)
    covariance: Floats  # (n, n) of measuring them
    places: Floats | None  # (n, 1 to 3); None: far from each other and from everything else


@dataclass(frozen=True, slots=True, eq=False)
class SpeedField:
    """Posterior mean and variance of the speed at places (m,), and of its mean over a region."""

    mean: Floats  # (m,)
    variance: Floats  # (m,)
    with_region: Floats  # (m,) covariance of the speed at a place with the mean over the region
    region_mean: float
    region_variance: float

    @property
    def own_variance(self) -> Floats:
        """Variance (m,) of what a place differs by from the mean over the region."""
        own = self.variance - 2.0 * self.with_region + self.region_variance
        return np.maximum(own, 0.0)


def speed_field(
    points: PointSpeeds, prior: SpeedPrior, places: Floats | None, region: Floats | None
) -> SpeedField:
    """Return the posterior of the speed, given points.

    Args:
        points: What was measured.
        prior: The distribution without points.
        places: Where the speed is wanted (m, k); None: nowhere.
        region: Places (r, k) whose mean is wanted too; None: the mean of the patient.
    """
    some = None if region is None else region[:: -(-len(region) // MOST_OF_REGION)]
    wanted = np.zeros((0, 1)) if places is None else places
    patient, local = prior.patient_sd_mm_per_us**2, prior.local_sd_mm_per_us**2

    def with_points(at: Floats) -> Floats:
        return patient + local * _likeness(at, points.places, prior, len(points.speeds))

    whole = patient + local * correlation(points.places, len(points.speeds), prior)
    whole = whole + points.covariance
    gain = np.linalg.solve(whole, np.eye(len(whole)))
    off = points.speeds - prior.mean_mm_per_us
    at_places = with_points(wanted)
    if some is None:
        at_region = np.full(len(off), patient)
        prior_with, prior_region = np.full(len(wanted), patient), patient
    else:
        at_region = with_points(some).mean(axis=0)
        prior_with = patient + local * _likeness(wanted, some, prior, len(some)).mean(axis=1)
        prior_region = patient + local * float(_likeness(some, some, prior, len(some)).mean())
    return SpeedField(
        mean=prior.mean_mm_per_us + at_places @ gain @ off,
        variance=np.maximum(patient + local - ((at_places @ gain) * at_places).sum(axis=1), 0.0),
        with_region=prior_with - at_places @ gain @ at_region,
        region_mean=prior.mean_mm_per_us + float(at_region @ gain @ off),
        region_variance=max(prior_region - float(at_region @ gain @ at_region), 0.0),
    )


def field_covariance(points: PointSpeeds, prior: SpeedPrior, places: Floats) -> Floats:
    """Return the posterior covariance (m, m) of the speed at places (m, k), given points."""
    patient, local = prior.patient_sd_mm_per_us**2, prior.local_sd_mm_per_us**2
    n = len(points.speeds)
    whole = patient + local * correlation(points.places, n, prior) + points.covariance
    across = patient + local * _likeness(places, points.places, prior, n)
    before = patient + local * _likeness(places, places, prior, len(places))
    return before - across @ np.linalg.solve(whole, across.T)


def local_spread(points: PointSpeeds, prior: SpeedPrior) -> float:
    """Return the standard deviation of places about their patient that fits points best.

    Of the spreads that the prior holds possible, the RMS, each counting as likely as it makes the
    points. Few points say little about it.
    """
    factors = np.exp(prior.local_log_sd * QUANTILES)
    log_weights = -0.5 * QUANTILES**2
    shares = np.exp(log_weights) / np.exp(log_weights).sum()
    factors = factors / np.sqrt(shares @ factors**2)  # the prior's spread is their RMS
    alike = correlation(points.places, len(points.speeds), prior)
    off = points.speeds - prior.mean_mm_per_us
    wholes = points.covariance + prior.patient_sd_mm_per_us**2
    wholes = wholes + (factors[:, None, None] * prior.local_sd_mm_per_us) ** 2 * alike
    misfit = np.linalg.solve(wholes, np.broadcast_to(off[:, None], (len(factors), len(off), 1)))
    log_weights -= 0.5 * (misfit[:, :, 0] @ off + np.linalg.slogdet(wholes)[1])
    weights = np.exp(log_weights - log_weights.max())
    return prior.local_sd_mm_per_us * float(np.sqrt(weights @ factors**2 / weights.sum()))


def correlation(places: Floats | None, n: int, prior: SpeedPrior) -> Floats:
    """Return how alike the speeds at n places are against their patient's mean (n, n), 0 to 1."""
    return np.eye(n) if places is None else _likeness(places, places, prior, n)


def _likeness(a: Floats, b: Floats | None, prior: SpeedPrior, n: int) -> Floats:
    """Return the correlation (m, n) of places (m, k) and (n, k); 0 with non-finite places."""
    if b is None or not len(a):
        return np.zeros((len(a), n))
    return np.exp(-0.5 * cdist(a, b, "sqeuclidean") / prior.local_length_mm**2)
