"""Figures of a placement, the chance that it keeps its limit, and its rank.

Probability that a bed keeps its limit, from the thinnest bone that it has in each draw. The least
of many correlated heights has a longer lower than upper tail, so a normal distribution fitted to
all draws promises too much (0.996 where 0.990 is true), and a count of 200 draws cannot tell 0.99
from 1. A normal distribution fitted to the lower half alone does neither.

Draws are as wide as the maps say, and how wide that ought to be differs from patient to patient: a
groove that is narrower than the beam is in no draw. So a limit below the median is as likely to
be kept as by Student's t of 10 degrees of freedom. On 98 patients that may be tuned with 2.3 % of
beds broke a limit that a normal distribution promised with 0.99, and 1.0 % with this one.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.pose import Pose
from rona_core.planning.bed import Screw
from rona_core.planning.placement.problem import Placement, PlacementLimits

NORMAL_95 = 1.96
MEDIAN_VARIANCE = np.pi / 2.0  # of the median of n normal values, times n / sigma^2
SPREAD_VARIANCE = 1.0  # of the relative spread of their half, times n: 1 / (2 n / 2)
LEAST_SPREAD_MM = 1e-6
FREEDOM = 10.0  # degrees, of Student's t


@dataclass(frozen=True, slots=True)
class Chance:
    """A probability, and where it lies in 95 % of sets of as many draws."""

    probability: float
    low: float
    high: float
    score: float  # standard normal quantile of the probability: it ranks what is nearly 0 or 1


def chance_above(values_mm: Floats, limit_mm: float) -> Chance:
    """Return the probability that the bone is at least ``limit_mm`` where a bed leaves the least.

    Args:
        values_mm: Of the draws (n,), in millimetres.
        limit_mm: Of what is safe.
    """
    spreads = spreads_above(values_mm, limit_mm)
    error = NORMAL_95 * np.sqrt((MEDIAN_VARIANCE + SPREAD_VARIANCE * spreads**2) / len(values_mm))
    low, score, high = (float(normal_quantile(spreads + off)) for off in (-error, 0.0, error))
    return Chance(float(ndtr(score)), float(ndtr(low)), float(ndtr(high)), score)


def spreads_above(values_mm: Floats, limit_mm: float) -> Floats:
    """Return by how many spreads the median of draws (n, ...) is above a limit.

    The spread is that of the half on the side of the limit.
    """
    median = np.median(values_mm, axis=0)
    above = median - limit_mm
    off = np.minimum(np.where(above >= 0.0, 1.0, -1.0) * (values_mm - median), 0.0)
    spread = np.sqrt((off**2).sum(axis=0) / np.maximum((off < 0.0).sum(axis=0), 1))
    return above / np.maximum(spread, LEAST_SPREAD_MM)


def spreads_for(probability: float) -> float:
    """Return how many spreads the median has to be above a limit that is kept so surely."""
    return float(stdtrit(FREEDOM, probability) if probability > 0.5 else ndtri(probability))


def normal_quantile(spreads: Floats) -> Floats:
    """Return the standard normal quantile of the probability of being so many spreads above."""
    return np.where(spreads > 0.0, -ndtri(stdtr(FREEDOM, -np.abs(spreads))), spreads)


ROOM_MM = 5.0  # to what is not mapped or is avoided: more is no better (assumed)
ROOM_WEIGHT = 0.1  # of a millimetre of room against one of bone or of protrusion (assumed)


class Shortfall(IntEnum):
    """What a placement lacks first."""

    NONE = 0  # it is safe
    UNMAPPED = 1  # it reaches cells where a boundary is not mapped
    ZONE = 2  # it comes too close to a zone
    THIN = 3  # the map itself has too little bone
    UNSURE = 4  # the map has enough bone, but not surely enough


@dataclass(frozen=True, slots=True)
class ScrewFigures:
    """Bone at one screw."""

    screw: Screw
    bone_mm: float  # from the outer map along the screw, where it is least around its end
    chance: Chance  # of more bone than the screw is long


@dataclass(frozen=True, slots=True, eq=False)
class PlacementFigures:
    """One placement of a bed. Of one that is not wholly mapped only the place is known."""

    placement: Placement
    T_map_bed: Pose
    shortfall: Shortfall
    chance: Chance | None  # of the least residual everywhere below the bed
    residual_mm: float | None  # least, of the map
    thinnest_map: Vector3 | None  # (3,) place of the solid where that is
    rim_above_mm: float  # by which bone stands above the plane z = 0 at the rim, at most
    rim_below_mm: float  # by which the plane z = 0 stands out of the bone there, at most
    rim_rms_mm: float
    unmapped_mm: float  # from the bed and its screws to the next cell that is not mapped
    zone_mm: float  # by which zones are farther than they have to be; infinite without zones
    screws: tuple[ScrewFigures, ...]
    objective: float

    @property
    def probability(self) -> float:
        """Least probability of the bed and of each screw; 0 where it is not known."""
        if self.chance is None:
            return 0.0
        return min(self.chance.probability, *(s.chance.probability for s in self.screws), 1.0)


def objective(
    limits: PlacementLimits,
    score: Floats | float,
    residual_mm: Floats | float,
    rim_mm: Floats | float,
    room_mm: Floats | float,
) -> Floats:
    """Return how good placements are: the probability up to the one required, then 1 and more.

    Beyond 1 a millimetre of bone left over the limit counts as one of protrusion less, and room
    around the bed counts a little: softplus of their sum, so that it stays above 1.

    Args:
        limits: Least residual and its probability.
        score: Standard normal quantile of the probability.
        residual_mm: Least residual of the map.
        rim_mm: Largest distance of the outer map from the plane z = 0 at the rim, either way.
        room_mm: To what is not mapped or is avoided.
    """
    probability = ndtr(score)
    room = ROOM_WEIGHT * np.clip(room_mm, 0.0, ROOM_MM)
    worth = np.logaddexp(0.0, residual_mm - limits.residual_mm - rim_mm + room)
    return np.where(probability >= limits.probability, 1.0 + worth, probability)
