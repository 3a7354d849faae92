"""One placement judged with all draws: some milliseconds, while the implant is dragged."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats, Vector3, readonly
from rona_core.geometry.pose import Pose
from rona_core.planning.placement.chance import Chance, chance_above
from rona_core.planning.placement.figures import (
    PlacementFigures,
    ScrewFigures,
    Shortfall,
    objective,
)
from rona_core.planning.placement.problem import PlacementProblem
from rona_core.planning.placement.residuals import (
    bed_margins,
    judge_screws,
    screw_places,
)
from rona_core.planning.placement.seat import Placement, lay_seats, tilted
from rona_core.planning.placement.settings import PlacementLimits
from rona_core.planning.placement.solid_points import SolidPoints


@dataclass(frozen=True, slots=True, eq=False)
class _Left:
    """What a bed that is wholly mapped leaves."""

    chance: Chance
    residual_mm: float
    thinnest_map: Vector3
    screws: tuple[ScrewFigures, ...]

    def score(self) -> float:
        """Return the least of the bed and its screws."""
        return min(self.chance.score, *(s.chance.score for s in self.screws), np.inf)

    def enough(self, limits: PlacementLimits) -> bool:
        """Return whether the map by itself has enough bone."""
        screws = all(s.bone_mm > s.screw.length_mm for s in self.screws)
        return screws and self.residual_mm >= limits.residual_mm


def judge_placement(
    problem: PlacementProblem, solid: SolidPoints, placement: Placement
) -> PlacementFigures:
    """Return what a bed would leave of the bone, with its probability.

    Args:
        problem: Bone, limits, errors of execution and zones.
        solid: Of the bed, see ``solid_points``.
        placement: Where it is laid.
    """
    bone, limits = problem.bone, problem.limits
    place = np.array([[placement.u_mm, placement.v_mm]])
    seats = lay_seats(bone, solid.rim, place, np.array([placement.angle_rad]))
    T_map_bed = tilted(seats, 0, placement)
    lift = solid.rim[:, 1] * placement.tilt_x_rad - solid.rim[:, 0] * placement.tilt_y_rad
    rim_mm = seats.rim_mm[0] - lift
    floor_map = T_map_bed @ solid.floor
    rim_map = T_map_bed @ np.column_stack((solid.rim, np.zeros(len(solid.rim))))
    screws_map = screw_places(bone, T_map_bed, solid.screws)
    touched = np.concatenate((floor_map, rim_map, screws_map.reshape(-1, 3)))[:, :2]
    zone_mm = float(problem.zone_clearance_mm(touched).min())
    covered, unmapped_mm, left = bool(bone.covered(touched).all()), 0.0, None
    if covered:
        unmapped_mm = float((bone.grid.operator(touched) @ bone.unmapped_mm.ravel()).min())
        left = _left(problem, solid, T_map_bed, floor_map, screws_map)
    rim = float(np.abs(rim_mm).max())
    shortfall, value = _rank(limits, left, rim, unmapped_mm, zone_mm)
    return PlacementFigures(
        placement=placement,
        T_map_bed=T_map_bed,
        shortfall=shortfall,
        chance=left.chance if left else None,
        residual_mm=left.residual_mm if left else None,
        thinnest_map=left.thinnest_map if left else None,
        rim_above_mm=max(0.0, float(rim_mm.max())),
        rim_below_mm=max(0.0, -float(rim_mm.min())),
        rim_rms_mm=float(np.sqrt((rim_mm**2).mean())),
        unmapped_mm=unmapped_mm,
        zone_mm=zone_mm,
        screws=left.screws if left else (),
        objective=value,
    )


def _rank(
    limits: PlacementLimits, left: _Left | None, rim_mm: float, unmapped_mm: float, zone_mm: float
) -> tuple[Shortfall, float]:
    """Return what a placement lacks and its objective."""
    if left is None:
        return Shortfall.UNMAPPED, 0.0
    if zone_mm < 0.0:
        return Shortfall.ZONE, 0.0
    room_mm = min(unmapped_mm, zone_mm)
    value = float(objective(limits, left.score(), left.residual_mm, rim_mm, room_mm))
    if value >= 1.0:
        return Shortfall.NONE, value
    return (Shortfall.UNSURE if left.enough(limits) else Shortfall.THIN), value


def _left(
    problem: PlacementProblem,
    solid: SolidPoints,
    T_map_bed: Pose,
    floor_map: Floats,
    screws_map: Floats,
) -> _Left:
    """Return the residual of a bed and the bone at its screws."""
    least, mapped = bed_margins(problem, T_map_bed, solid)
    thinnest = int(np.argmin(mapped))
    return _Left(
        chance=chance_above(least, 0.0),
        residual_mm=float(mapped[thinnest]),
        thinnest_map=readonly(floor_map[thinnest].copy()),
        screws=judge_screws(problem, T_map_bed, solid.screws, screws_map),
    )
