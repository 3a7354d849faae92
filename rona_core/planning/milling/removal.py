"""Bone that a milling path takes away, and whether an implant goes into what it leaves."""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import KDTree
from shapely.geometry.base import BaseGeometry

from rona_core.devices.limits import require, require_within
from rona_core.geometry.arrays import Floats, readonly
from rona_core.planning.bed import Bed
from rona_core.planning.implants.implant import Implant
from rona_core.planning.milling.burr import Burr, MillingSettings
from rona_core.planning.milling.milling_path import MillingPath
from rona_core.planning.milling.tool_regions import Level, levels

CELL_MM = 0.1
RIDGE_MM = 0.002  # that places along the path, instead of all of it, may leave
AROUND_MM = 0.5  # of the grid round a bed


def lowest_mm(path: MillingPath, x_mm: Floats, y_mm: Floats) -> Floats:
    """Return the lowest z (nx, ny) in ``bed`` that a burr reaches over each cell; else infinity.

    Args:
        path: All of its moves count, those in the air too.
        x_mm: Cell centres (nx,), evenly spaced.
        y_mm: Cell centres (ny,), as far apart.
    """
    lowest = np.full((len(x_mm), len(y_mm)), np.inf)
    bottoms = path.bottoms_bed()
    for tool, burr in enumerate(path.burrs):
        for place in _places(bottoms, path.tools == tool, burr):
            _take(lowest, place, burr, x_mm, y_mm)
    return lowest


def removed_bed(path: MillingPath, x_mm: Floats, y_mm: Floats) -> Bed:
    """Return what a path removes below z = 0 over a grid."""
    depth = np.maximum(-lowest_mm(path, x_mm, y_mm), 0.0)
    return Bed(x_mm, y_mm, readonly(depth))


def planned_bed(
    implant: Implant,
    settings: MillingSettings | None = None,
    surface_mm: float = 0.0,
    cell_mm: float = CELL_MM,
) -> Bed:
    """Return what the path of ``plan_milling`` removes, without that path and without its ridges.

    A burr that comes to every place of a region at one depth sweeps its own shape round that
    region: the grey dilation of the region by the burr, here by distances to its outline. It is
    nowhere shallower than what the path removes, and deeper by no more than the ridges between
    rings, but for cells on a wall.

    Args:
        implant: With its lift.
        settings: Of the path.
        surface_mm: Of the path.
        cell_mm: Width of a cell, 0.02 to 2 mm.

    Raises:
        InvalidInputError: a burr larger than the bed, or a value outside its range.
    """
    settings = settings or MillingSettings()
    found = levels(implant, settings, surface_mm)
    x_mm, y_mm = grid_of(implant, settings, cell_mm)
    x, y = np.meshgrid(x_mm, y_mm, indexing="ij")
    places = np.column_stack((x.ravel(), y.ravel()))
    depth = np.zeros(len(places))
    for level in _deepest(found):
        if level.depth_mm <= 0.0:
            continue
        burr = settings.burrs[level.burr]
        rise = burr.rise_mm(_distances(level.region, places, burr.radius_mm))
        np.maximum(depth, level.depth_mm - rise, out=depth)
    return Bed(readonly(x_mm), readonly(y_mm), readonly(depth.reshape(x.shape).copy()))


def grid_of(
    implant: Implant, settings: MillingSettings, cell_mm: float = CELL_MM
) -> tuple[Floats, Floats]:
    """Return the cell centres along x and y of a grid round the bed; one cell is at the origin.

    Raises:
        InvalidInputError: ``cell_mm`` outside 0.02 to 2 mm.
    """
    require_within("cell_mm", cell_mm, 0.02, 2.0)
    bounds = np.array(implant.terraces()[0].region.bounds).reshape(2, 2)
    room = settings.side_clearance_mm + AROUND_MM
    low = np.floor((bounds[0] - room) / cell_mm)
    high = np.ceil((bounds[1] + room) / cell_mm)
    x_mm, y_mm = (cell_mm * np.arange(a, b + 1.0) for a, b in zip(low, high, strict=True))
    return readonly(x_mm), readonly(y_mm)


def _deepest(found: tuple[Level, ...]) -> list[Level]:
    """Return the levels without those above another of the same burr and region."""
    return [
        level
        for level, below in zip(found, (*found[1:], None), strict=True)
        if below is None
        or below.burr != level.burr
        or not shapely.equals_exact(level.region, below.region, tolerance=1e-9)
    ]


def _distances(region: BaseGeometry, places: Floats, reach_mm: float) -> Floats:
    """Return how far places (n, 2) are from a region; beyond ``reach_mm`` infinity."""
    shapely.prepare(region)
    inside = shapely.intersects_xy(region, places[:, 0], places[:, 1])
    line = shapely.segmentize(shapely.boundary(region), 0.5 * CELL_MM)
    outline = KDTree(shapely.get_coordinates(line))
    distances = np.zeros(len(places))
    away = outline.query(places[~inside], distance_upper_bound=reach_mm)[0]
    distances[~inside] = away
    return distances


def _places(bottoms: Floats, own: np.typing.NDArray[np.bool_], burr: Burr) -> Floats:
    """Return places (m, 3) along the moves of one burr, close enough that no ridges are left."""
    step_mm = float(np.sqrt(8.0 * burr.radius_mm * RIDGE_MM))
    ends = np.flatnonzero(own[1:] & own[:-1]) + 1
    steps = bottoms[ends] - bottoms[ends - 1]
    counts = np.maximum(np.ceil(np.linalg.norm(steps, axis=1) / step_mm), 1.0).astype(np.int64)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    shares = (number + 1.0) / np.repeat(counts, counts)
    places = np.repeat(bottoms[ends - 1], counts, axis=0)
    places += shares[:, None] * np.repeat(steps, counts, axis=0)
    return np.vstack((bottoms[own][:1], places))


def _take(lowest: Floats, place: Floats, burr: Burr, x_mm: Floats, y_mm: Floats) -> None:
    """Lower the cells that a burr with its lowest place (3,) reaches."""
    radius = burr.radius_mm
    i = slice(*np.searchsorted(x_mm, (place[0] - radius, place[0] + radius)))
    j = slice(*np.searchsorted(y_mm, (place[1] - radius, place[1] + radius)))
    if i.start == i.stop or j.start == j.stop:
        return
    away = np.sqrt(((x_mm[i] - place[0]) ** 2)[:, None] + (y_mm[j] - place[1]) ** 2)
    np.minimum(lowest[i, j], place[2] + burr.rise_mm(away), out=lowest[i, j])


MOST_OVERLAP_MM = 0.05


@dataclass(frozen=True, slots=True)
class Fit:
    """How an implant lies in a bed, over the cells below it."""

    overlap_mm: float  # most that it would be stuck in the bone; 0 if it goes in
    gap_min_mm: float  # least room below it; 0 where it is stuck
    gap_mean_mm: float

    @property
    def goes_in(self) -> bool:
        """Return whether the implant goes in."""
        return self.overlap_mm <= MOST_OVERLAP_MM


def fit(implant: Implant, bed: Bed) -> Fit:
    """Return how an implant goes straight down into a bed; neither has an undercut.

    Raises:
        InvalidInputError: the grid of the bed does not reach round the implant.
    """
    outline = np.vstack(implant.outline())
    low, high = outline.min(axis=0), outline.max(axis=0)
    first, last = (bed.x_mm[0], bed.y_mm[0]), (bed.x_mm[-1], bed.y_mm[-1])
    require(
        bool((low >= first).all() and (high <= last).all()),
        f"the bed is known from {first[0]:g}, {first[1]:g} to {last[0]:g}, {last[1]:g} mm, which "
        f"does not reach round {implant.name}: compute it over a larger grid",
    )
    needed = implant.depth_mm(bed.x_mm, bed.y_mm)
    below = needed > 0.0
    gaps = bed.depth_mm[below] - needed[below]
    return Fit(
        overlap_mm=max(0.0, -float(gaps.min())),
        gap_min_mm=max(0.0, float(gaps.min())),
        gap_mean_mm=float(np.maximum(gaps, 0.0).mean()),
    )
