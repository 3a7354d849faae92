"""What is said of one placement, and how placements are ranked."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from scipy.special import ndtr

from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.pose import Pose
from rona_core.planning.bed import Screw
from rona_core.planning.placement.chance import Chance
from rona_core.planning.placement.seat import Placement
from rona_core.planning.placement.settings import PlacementLimits

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
