"""Weights of reference points: an outlier counts less, as under Student's t (Lange 1989)."""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.acoustic_calibration.speed_field import (
    PointSpeeds,
    local_spread,
    speed_field,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import SpeedPrior

LEAST_POINTS = 3  # of which one can be found to be an outlier
FREEDOM = 4.0  # of Student's t: how much a single outlier counts
ROUNDS = 10


@dataclass(frozen=True, slots=True, eq=False)
class WeighedPoints:
    """Speeds at reference points (n,), outliers with a larger variance, and a prior with them."""

    points: PointSpeeds
    variances: Floats  # (n,) without what the points have in common, (mm/us)^2
    prior: SpeedPrior  # places differ as far as the points say
    residuals: Floats  # (n,) over what is expected of them
    weights: Floats  # (n,) that these residuals ask for, at most 1


def weigh_points(
    speeds: Floats, measured: Floats, common: Floats, positions: Floats | None, prior: SpeedPrior
) -> WeighedPoints:
    """Return reference points with their weights; all of them count fully where they are few.

    Args:
        speeds: At the points (n,) in mm/us.
        measured: Variances of measuring them, each for itself (n,), in (mm/us)^2.
        common: Standard deviations of what errs in all of them alike (n,), in mm/us.
        positions: Of the points (n, 1 to 3); None where they are far from each other.
        prior: The distribution without the points.
    """
    expected = np.sqrt(measured + common**2 + prior.local_sd_mm_per_us**2)

    def weighed(weights: Floats) -> WeighedPoints:
        variances = measured + expected**2 * (1.0 / weights - 1.0)
        points = PointSpeeds(speeds, np.diag(variances) + np.outer(common, common), positions)
        found = replace(prior, local_sd_mm_per_us=local_spread(points, prior))
        mean = speed_field(points, found, None, None).region_mean
        residuals = (speeds - mean) / expected
        if len(speeds) >= LEAST_POINTS:
            weights = np.minimum((FREEDOM + 1.0) / (FREEDOM + residuals**2), 1.0)
        return WeighedPoints(points, variances, found, residuals, weights)

    result = weighed(np.ones(len(speeds)))
    for _ in range(ROUNDS - 1 if len(speeds) >= LEAST_POINTS else 0):
        result = weighed(result.weights)
    return result
