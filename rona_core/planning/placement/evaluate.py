"""One placement judged with all draws: some milliseconds, while the implant is dragged.

Places of a bed that are looked at: the lowest of every block of cells, and its rim. The bone left
below a bed is at least some limit where the inner boundary stays out of the bed grown by that
limit, so the lower side of that solid is looked at as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion, grey_dilation, map_coordinates

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Bools, Floats, Vector3, readonly
from rona_core.geometry.pose import Pose
from rona_core.planning.bed import Bed, Screw
from rona_core.planning.placement.figures import (
    Chance,
    PlacementFigures,
    ScrewFigures,
    Shortfall,
    chance_above,
    objective,
)
from rona_core.planning.placement.problem import (
    MappedBone,
    Placement,
    PlacementLimits,
    PlacementProblem,
    lay_seats,
    tilted,
)

RIM_POINTS = 48
MOST_GROWN_MM = 2.5  # at once
TURNS = (24, 4, 2)  # a full turn by these that gives the same bed: round, square, oblong
JAGGED_MM = 0.3  # of the rim in cells: it does not count in a turn
SAME_SHARE = 0.01  # of the other cells may differ after a turn
SAME_DEPTH = 0.05  # of the largest depth


@dataclass(frozen=True, slots=True, eq=False)
class SolidPoints:
    """Places in frame ``bed``: of the swept solid, of its rim, and of the screws' ends."""

    floor: Floats  # (n, 3) on its lower side
    offset: Floats  # (k, 3) on the lower side of that solid grown by the limit
    rim: Floats  # (m, 2) of the outermost cells
    screws: tuple[Screw, ...]
    turn_rad: float  # after which the bed looks the same; 0: it is round


def solid_points(problem: PlacementProblem, bed: Bed, screws: Sequence[Screw] = ()) -> SolidPoints:
    """Return the places of a bed that decide what bone it leaves.

    Args:
        problem: With the cells of the map and the limit.
        bed: The solid that the burr sweeps.
        screws: Beside it.

    Raises:
        InvalidInputError: the burr takes nothing away, or the cells are not even.
    """
    check_bed(bed)
    cut, cell_mm = bed.cut(), problem.bone.cell_mm
    turns = [n for n in TURNS if not screws and _same_after(bed, cut, 2.0 * np.pi / n)]
    most = max(turns, default=1)
    return SolidPoints(
        floor=lowest_of_blocks(bed, cell_mm),
        offset=lowest_of_blocks(offset_bed(bed, problem.limits.residual_mm), cell_mm),
        rim=readonly(_rim(bed, cut)),
        screws=tuple(screws),
        turn_rad=0.0 if most == TURNS[0] else 2.0 * np.pi / most,
    )


def lowest_of_blocks(bed: Bed, block_mm: float) -> Floats:
    """Return the lowest cell (n, 3) of each block of a bed, in ``bed``.

    Of equally low ones that farthest out: above a boundary that is smooth over a block, no other
    cell comes closer to it.
    """
    i, j = np.nonzero(bed.cut())
    x, y, depth = bed.x_mm[i], bed.y_mm[j], bed.depth_mm[i, j]
    middle = np.array([np.ptp(x) / 2 + x.min(), np.ptp(y) / 2 + y.min()])
    out = np.hypot(x - middle[0], y - middle[1])
    blocks = np.floor(np.stack((x, y)) / block_mm).astype(np.int64)
    order = np.lexsort((-out, -depth.round(6), blocks[1], blocks[0]))
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(blocks[:, order], axis=1) != 0).any(axis=0)
    return readonly(np.column_stack((x, y, -depth))[order[first]])


def offset_bed(bed: Bed, distance_mm: float) -> Bed:
    """Return a bed grown by a distance to all sides: the grey dilation of its depths by a ball.

    A large ball is the Minkowski sum of small ones, which take far less time one after the other.
    On cells of 0.1 mm the bed is then up to 0.01 mm too small where it is not steeper than 60
    degrees; up to 2.5 mm it is exact (Serra 1982, dilation by a sum of sets).
    """
    rounds = max(1, int(np.ceil(distance_mm / MOST_GROWN_MM)))
    for _ in range(rounds):
        bed = _grown(bed, distance_mm / rounds)
    return bed


def _grown(bed: Bed, radius_mm: float) -> Bed:
    step_mm = float(bed.x_mm[1] - bed.x_mm[0])
    count = int(radius_mm / step_mm)
    steps = step_mm * np.arange(-count, count + 1)
    under = radius_mm**2 - steps[:, None] ** 2 - steps**2
    ball = np.where(under >= 0.0, np.sqrt(np.maximum(under, 0.0)), -np.inf)
    below = np.pad(np.where(bed.cut(), bed.depth_mm, -np.inf), count, constant_values=-np.inf)
    grown = np.asarray(grey_dilation(below, structure=ball, mode="constant", cval=-np.inf))
    x_mm, y_mm = (
        np.concatenate((axis[0] + steps[:count], axis, axis[-1] + steps[count + 1 :]))
        for axis in (bed.x_mm, bed.y_mm)
    )
    return Bed(x_mm, y_mm, np.maximum(grown, 0.0))


def check_bed(bed: Bed) -> None:
    """Raise InvalidInputError where a bed takes nothing away or has no even cells."""
    require(
        bed.depth_mm.shape == (len(bed.x_mm), len(bed.y_mm)) and min(bed.depth_mm.shape) >= 2,
        f"depth_mm is {bed.depth_mm.shape} over {len(bed.x_mm)} x {len(bed.y_mm)} cells of the bed",
    )
    steps = np.concatenate((np.diff(bed.x_mm), np.diff(bed.y_mm)))
    require(
        bool(steps.min() > 0.0 and np.ptp(steps) < 1e-6 * steps.max()),
        "cells of the bed must be evenly spaced, by as much along x as along y",
    )
    require(bool(np.isfinite(bed.depth_mm).all()), "depths of the bed must be finite")
    require(int(bed.cut().sum()) >= 3, "the burr takes nothing away: the bed has no depth")


def least_reach_mm(bed: Bed) -> float:
    """Return how far the bed reaches at least from its origin; 0 where that is not in it."""
    x, y = np.meshgrid(bed.x_mm, bed.y_mm, indexing="ij")
    away = np.hypot(x, y)
    outside = away[~bed.cut()]
    nearest = float(outside.min()) if len(outside) else np.inf
    border = min(-bed.x_mm[0], bed.x_mm[-1], -bed.y_mm[0], bed.y_mm[-1])
    return max(0.0, min(nearest - float(bed.x_mm[1] - bed.x_mm[0]), float(border)))


def _rim(bed: Bed, cut: Bools) -> Floats:
    """Return the outermost cells (m, 2) of a bed, in even steps around it."""
    i, j = np.nonzero(cut & ~_shrunk(cut, 1))
    rim = np.column_stack((bed.x_mm[i], bed.y_mm[j]))
    turn = np.arctan2(*(rim - rim.mean(axis=0)).T[::-1])
    rim = rim[np.argsort(turn)]
    steps = np.linalg.norm(np.diff(rim, axis=0, append=rim[:1]), axis=1)
    way = np.concatenate(((0.0,), np.cumsum(steps)[:-1]))
    wanted = np.linspace(0.0, steps.sum(), min(RIM_POINTS, len(rim)), endpoint=False)
    return rim[np.unique(np.searchsorted(way, wanted).clip(0, len(rim) - 1))]


def _shrunk(cut: Bools, cells: int) -> Bools:
    return np.asarray(binary_erosion(cut, iterations=cells), dtype=np.bool_)


def _same_after(bed: Bed, cut: Bools, turn_rad: float) -> bool:
    """Return whether a bed turned about its origin covers the same cells."""
    step = bed.x_mm[1] - bed.x_mm[0]
    x, y = np.meshgrid(bed.x_mm, bed.y_mm, indexing="ij")
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
    rows = (cosine * x - sine * y - bed.x_mm[0]) / step
    columns = (sine * x + cosine * y - bed.y_mm[0]) / step
    turned = map_coordinates(bed.depth_mm, (rows, columns), order=1, mode="constant")
    differing = np.abs(turned - bed.depth_mm) > SAME_DEPTH * bed.depth_mm.max()
    inside = _shrunk(cut, max(1, int(np.ceil(JAGGED_MM / step))))
    return bool((differing & inside).sum() <= SAME_SHARE * cut.sum())


TURNS_RAD = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
AROUND = np.column_stack((np.cos(TURNS_RAD), np.sin(TURNS_RAD)))  # the end of a screw, in radii
AT_ONCE = 512  # points that are worked on together: thousands with all draws take much memory
ROUNDS = 4  # of finding the outer boundary along a screw: the map is flat, each gains a digit


def residuals(
    problem: PlacementProblem, T_map_bed: Pose, points_map: Floats
) -> tuple[Floats, Floats]:
    """Return the shortest way from points (m, 3) to the inner boundary, in draws and in the map.

    Vertical distance times the cosine of the boundary's slope; a bed that is milled elsewhere than
    planned is closer by its shift along the boundary's normal.

    Returns:
        In the draws (m, n), in the map (m,).
    """
    drawn, mapped, _ = _to_inner(problem, T_map_bed, points_map)
    return drawn, mapped


def depths_along_axis(
    problem: PlacementProblem, T_map_bed: Pose, points_map: Floats
) -> tuple[Floats, Floats]:
    """Return the distance from points (m, 3) along the axis of a bed to the inner boundary.

    What a probe measures that stands on a floor: over a boundary that leans it is more than the
    shortest way, see ``residuals``.

    Returns:
        In the draws (m, n), in the map (m,).
    """
    drawn, mapped, normals_bed = _to_inner(problem, T_map_bed, points_map)
    drawn /= normals_bed[:, 2:]
    return drawn, mapped / normals_bed[:, 2]


def _to_inner(
    problem: PlacementProblem, T_map_bed: Pose, points_map: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return ``residuals``, and the outward normals (m, 3) of the inner map in ``bed``."""
    inner = problem.bone.inner_boundary
    operator = inner.grid.operator(points_map[:, :2])
    cosine = operator @ inner.cosine
    slopes = operator @ inner.slopes
    mapped = cosine * (points_map[:, 2] - operator @ inner.height_mm)
    normals_map = cosine[:, None] * np.column_stack((-slopes, np.ones(len(slopes))))
    normals_bed = normals_map @ T_map_bed.rotation
    operator.data *= np.repeat(-cosine, np.diff(operator.indptr))
    drawn = operator @ inner.draws_mm
    same = np.column_stack((cosine * points_map[:, 2], normals_bed))
    errors = np.vstack((np.ones(problem.bone.draws), problem.errors_bed))
    for start in range(0, len(drawn), AT_ONCE):
        drawn[start : start + AT_ONCE] += same[start : start + AT_ONCE] @ errors
    return drawn, mapped, normals_bed


def bed_margins(
    problem: PlacementProblem, T_map_bed: Pose, solid: SolidPoints
) -> tuple[Floats, Floats]:
    """Return the least bone below a bed over what is required, and what the map leaves below it.

    Less than 0 where the bone below the floor is too thin, or where the boundary of that draw
    reaches into the bed grown by the limit: its nearest place need not be the one below. Where the
    maps end the bone beside a bed is not looked at.

    Returns:
        Over what is required, in the draws (n,); below the places of the floor in the map (m,).
    """
    below, mapped = residuals(problem, T_map_bed, T_map_bed @ solid.floor)
    offset_map = T_map_bed @ solid.offset
    covered = problem.bone.covered(offset_map[:, :2])
    around, _ = residuals(problem, T_map_bed, offset_map[covered])
    least = below.min(axis=0) - problem.limits.residual_mm
    return np.minimum(least, around.min(axis=0, initial=np.inf)), mapped


def margins(problem: PlacementProblem, T_map_bed: Pose, solid: SolidPoints) -> Floats:
    """Return the least bone over what is required, below a bed or beyond a screw, in draws (n,)."""
    least, _ = bed_margins(problem, T_map_bed, solid)
    if not solid.screws:
        return least
    places_map = screw_places(problem.bone, T_map_bed, solid.screws)
    return np.minimum(least, beyond_screws(problem, T_map_bed, places_map)[0].min(axis=0))


def screw_places(bone: MappedBone, T_map_bed: Pose, screws: Sequence[Screw]) -> Floats:
    """Return where s screws go in, then places around the end of each (s, 1 + 9, 3), in ``map``.

    A screw goes in where its axis meets the outer map.
    """
    heads = np.array([(screw.x_mm, screw.y_mm, 0.0) for screw in screws]).reshape(-1, 3)
    axis_map = T_map_bed.rotation[:, 2]
    start = T_map_bed @ heads
    for _ in range(ROUNDS):
        start += ((bone.outer_at(start[:, :2]) - start[:, 2]) / axis_map[2])[:, None] * axis_map
    length = np.array([screw.length_mm for screw in screws])
    radius = np.array([0.5 * screw.diameter_mm for screw in screws])
    ends = np.zeros((len(screws), 1 + len(AROUND), 3))
    ends[:, 1:, :2] = radius[:, None, None] * AROUND
    ends[:, :, 2] -= length[:, None]
    return np.concatenate((start[:, None], start[:, None] + T_map_bed.rotate(ends)), axis=1)


def judge_screws(
    problem: PlacementProblem, T_map_bed: Pose, screws: Sequence[Screw], places_map: Floats
) -> tuple[ScrewFigures, ...]:
    """Return the bone at s screws, whose entries and ends (s, 1 + 9, 3) are given."""
    if not screws:
        return ()
    drawn, mapped = beyond_screws(problem, T_map_bed, places_map)
    return tuple(
        ScrewFigures(screw, screw.length_mm + float(more), chance_above(beyond, 0.0))
        for screw, beyond, more in zip(screws, drawn, mapped, strict=True)
    )


def beyond_screws(
    problem: PlacementProblem, T_map_bed: Pose, places_map: Floats
) -> tuple[Floats, Floats]:
    """Return the bone beyond the ends of s screws, in draws (s, n) and in the map (s,).

    A screw rides on the true outer boundary, wherever that is: the depth of the bed does not
    matter.

    Args:
        problem: Bone and errors of execution.
        T_map_bed: Of the bed.
        places_map: Entries and ends (s, 1 + 9, 3), see ``screw_places``.
    """
    bone, (count, each, _) = problem.bone, places_map.shape
    entry = bone.grid.operator(places_map[:, 0, :2])
    outer_off = entry @ bone.outer_draws - (entry @ bone.outer.height_mm.ravel())[:, None]
    drawn, mapped = residuals(problem, T_map_bed, places_map[:, 1:].reshape(-1, 3))
    least = drawn.reshape(count, each - 1, -1).min(axis=1)
    depth_error = T_map_bed.rotation[2, 2] * problem.errors_bed[2]
    return least + outer_off - depth_error, mapped.reshape(count, -1).min(axis=1)


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
