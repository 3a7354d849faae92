"""The bed of an implant as a session holds it."""

from dataclasses import dataclass, field
from typing import Literal

from rona_core.geometry.arrays import Floats, Ints, Vector3
from rona_core.geometry.pose import Pose
from rona_core.planning.placement.figures import Chance, ScrewFigures
from rona_core.planning.placement.problem import Placement
from rona_core.session.codec import OMIT_EMPTY

Lacks = Literal["nothing", "maps", "distance", "bone", "certainty"]
LACKS: tuple[Lacks, ...] = ("nothing", "maps", "distance", "bone", "certainty")  # by `Shortfall`


@dataclass(frozen=True, slots=True)
class TriedLift:
    """One lift of a search, and the probability of its best placement."""

    lift_mm: float
    probability: float


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBed:
    """A bed laid on the bone. What is None is not known, since not all of the bed is mapped."""

    placement: Placement
    T_base_bed: Pose
    lacks: Lacks
    chance: Chance | None  # that the limit holds everywhere below the bed
    residual_mm: float | None  # least bone below it, by the maps
    thinnest_base: Vector3 | None  # (3,) lowest place of the bed there
    rim_above_mm: float  # by which bone stands above the seat at the rim, at most
    rim_below_mm: float  # by which the seat stands out of the bone there, at most
    unmapped_mm: float  # to the next cell that is not mapped
    screws: tuple[ScrewFigures, ...]

    @property
    def probability(self) -> float:
        """Least probability of the bed and of each screw; 0 where it is not known."""
        if self.chance is None:
            return 0.0
        return min(self.chance.probability, *(s.chance.probability for s in self.screws), 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class ImplantBed:
    """Step 10: an implant, what was asked of its bed, and where that lies."""

    implant: str
    lift_mm: float
    limit_mm: float
    required: float  # probability
    burr_mm: float
    placed: PlacedBed | None  # None: nowhere is it wholly mapped
    refusal: str | None  # why it is not safe; None where it is
    tried: tuple[TriedLift, ...] = ()  # of a search
    probability: Floats | None = None  # (nu, nv) with its middle in each cell, best turned; search
    lacks: Ints | None = None  # (nu, nv) of these, rows of ``LACKS``
    # 3D standard deviation of the registered tip of the burr; None: it was not registered
    burr_sigma_mm: float | None = field(default=None, metadata=OMIT_EMPTY)
