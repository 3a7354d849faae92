"""Places of a bed that are looked at: the lowest of every block of cells, and its rim.

The bone left below a bed is at least some limit where the inner boundary stays out of the bed grown
by that limit, so the lower side of that solid is looked at as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion, grey_dilation, map_coordinates

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.planning.bed import Bed, Screw
from rona_core.planning.placement.problem import PlacementProblem

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
