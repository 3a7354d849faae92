"""Where the middle of a burr may be at each depth of a bed, and rings over it.

Where the middle of a burr may be at each depth of a bed without cutting beyond the bed. At a depth
d the burr is as wide as its own height above its lowest place says; so its middle must keep that
far inside the outline of every terrace that it passes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from shapely.geometry import LineString
from shapely.geometry.base import BaseGeometry

from rona_core.devices.limits import require, require_within
from rona_core.geometry.arrays import Floats
from rona_core.planning.implants.implant import Implant
from rona_core.planning.implants.solids import Terrace
from rona_core.planning.milling.burr import Burr, MillingSettings

ARC_SEGMENTS = 32  # of a quarter circle
FLOOR_SHARE = 0.02  # of the outline's area: a smaller step has no layer of its own
ROOM_MM = 0.1  # round the axis of a burr, or it has no way down but with its pole
THIN_MM = 0.01  # half the width of a strip that counts as nothing: rounding of arcs
MOST_SURFACE_MM = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """One depth that one burr mills to."""

    burr: int  # in the order of use
    above_mm: float  # depth of the layer above it
    depth_mm: float
    region: BaseGeometry  # of the burr's middle
    wanted: BaseGeometry | None = None  # of a rim pass: what is still to be cut at this depth


def levels(implant: Implant, settings: MillingSettings, surface_mm: float) -> tuple[Level, ...]:
    """Return the layers of a bed from the top, then those of the rim pass.

    Args:
        implant: With its lift.
        settings: Burrs, layers and allowances.
        surface_mm: How far the bone within the outline rises above z = 0: layers begin there.

    Raises:
        InvalidInputError: a burr larger than the bed, or a surface outside 0 to 10 mm.
    """
    require_within("surface_mm", surface_mm, 0.0, MOST_SURFACE_MM)
    pocket = pocket_of(implant, settings)
    for burr in settings.burrs:
        room = offset(pocket[0].region, -burr.radius_mm - ROOM_MM)
        width_mm = 2.0 * inner_radius_mm(pocket[0].region)
        require(
            not room.is_empty,
            f"the burr of {burr.diameter_mm:g} mm is larger than the bed of {implant.name}, whose "
            f"outline is {width_mm:.3g} mm wide: take a smaller burr",
        )
    depths = _depths(pocket, settings.layer_mm, surface_mm)
    main = _levels_of(0, settings.burr, pocket, depths)
    if settings.rim_burr is None:
        return main
    rim: list[Level] = []
    for level in _levels_of(1, settings.rim_burr, pocket, depths):
        left = shapely.difference(
            region_at(pocket, level.depth_mm), _cut(main, settings.burr, level.depth_mm)
        )
        left = offset(offset(left, -THIN_MM), THIN_MM)
        if not left.is_empty:
            rim.append(Level(1, level.above_mm, level.depth_mm, level.region, left))
    return (*main, *rim)


def pocket_of(implant: Implant, settings: MillingSettings) -> tuple[Terrace, ...]:
    """Return what is to be cut: the terraces of an implant, wider and deeper by the allowances."""
    wider, deeper = settings.side_clearance_mm, settings.over_depth_mm
    return tuple(
        Terrace(terrace.depth_mm + deeper, offset(terrace.region, wider))
        for terrace in implant.terraces()
    )


def offset(region: BaseGeometry, by_mm: float) -> BaseGeometry:
    """Return a region that is wider by so much, or narrower if negative."""
    return region if by_mm == 0.0 else region.buffer(by_mm, quad_segs=ARC_SEGMENTS)


def inner_radius_mm(region: Any) -> float:
    """Return the radius of the largest circle in a region."""
    parts = shapely.get_parts(region)
    return max(float(shapely.maximum_inscribed_circle(part).length) for part in parts)


def region_at(pocket: Sequence[Terrace], depth_mm: float) -> BaseGeometry:
    """Return what is to be cut at a depth."""
    return next((t.region for t in pocket if t.depth_mm >= depth_mm - 1e-9), shapely.Polygon())


def _depths(pocket: Sequence[Terrace], layer_mm: float, surface_mm: float) -> list[float]:
    """Return the depths of all layers; each floor has one, and between floors they are even."""
    least_mm2 = FLOOR_SHARE * pocket[0].region.area
    floors = [
        terrace.depth_mm
        for terrace, below in pairwise(pocket)
        if terrace.region.area - below.region.area >= least_mm2
    ]
    depths = [-surface_mm]
    for floor_mm in (*floors, pocket[-1].depth_mm):
        top_mm = depths[-1]
        n = max(1, -int(-((floor_mm - top_mm) / layer_mm - 1e-9) // 1))
        depths += [top_mm + (floor_mm - top_mm) * (k + 1) / n for k in range(n)]
    return depths


def _levels_of(
    number: int, burr: Burr, pocket: Sequence[Terrace], depths: Sequence[float]
) -> tuple[Level, ...]:
    """Return the levels of one burr that its middle has room in."""
    found: list[Level] = []
    for above_mm, depth_mm in pairwise(depths):
        region = _middle_region(burr, pocket, depths[0], depth_mm)
        if not region.is_empty:
            found.append(Level(number, above_mm, depth_mm, region))
    return tuple(found)


def _middle_region(
    burr: Burr, pocket: Sequence[Terrace], top_mm: float, depth_mm: float
) -> BaseGeometry:
    """Return where the burr's middle may be at a depth, parts without room left out."""
    region: BaseGeometry | None = None
    for terrace in pocket:
        if top_mm >= depth_mm - 1e-9:
            break
        inside = offset(terrace.region, -burr.reach_mm(depth_mm - top_mm))
        region = inside if region is None else shapely.intersection(region, inside)
        top_mm = terrace.depth_mm
    parts = [] if region is None else [p for p in shapely.get_parts(region) if p.area > 0.0]
    return shapely.union_all([p for p in parts if not offset(p, -0.5 * ROOM_MM).is_empty])


def _cut(cuts: Sequence[Level], burr: Burr, depth_mm: float) -> BaseGeometry:
    """Return what levels of one burr have cut at a depth, as if there were no ridges."""
    lower = [level for level in cuts if level.depth_mm >= depth_mm - 1e-9]
    wide = [
        offset(level.region, burr.reach_mm(level.depth_mm - depth_mm))
        for level in lower
        if level.depth_mm - depth_mm < burr.radius_mm or level is lower[-1]
    ]
    return shapely.union_all(wide)


CHORD_MM = 0.002  # most that a ring is off by the corners of its polygon
SHORTEST_MM = 0.2  # a piece of a ring that is shorter is left out
MARGIN = (
    1.02  # of half a pitch: rings that touch are not distinguished from those that miss by rounding
)


def strokes(level: Level, burr: Burr, pitch_mm: float) -> list[Floats]:
    """Return the lines (n, 2) of one layer, from the inside out; those that close are rings.

    Args:
        level: Where the burr's middle may be, and what a rim pass is to cut.
        burr: Of that level.
        pitch_mm: Most distance between neighbouring rings.
    """
    rings, step_mm = _rings(level.region, pitch_mm)
    rings += _between(level.region, rings, step_mm)
    if level.wanted is None:
        return [np.asarray(shapely.get_coordinates(ring)) for ring in rings]
    # the outermost ring cuts up to the wall; of the others what passes over the rest
    outermost = shapely.boundary(level.region)
    near, at_wall = offset(level.wanted, 0.5 * step_mm), offset(level.wanted, burr.radius_mm)
    kept: list[Floats] = []
    for ring in rings:
        wall = shapely.dwithin(ring, outermost, CHORD_MM) and ring.length > 0.0
        kept += list(_pieces(shapely.intersection(ring, at_wall if wall else near)))
    return kept


def _rings(region: BaseGeometry, pitch_mm: float) -> tuple[list[BaseGeometry], float]:
    """Return rings from the inside out and how far they are apart."""
    inside_mm = inner_radius_mm(region)
    n = max(0, int(np.ceil(inside_mm / pitch_mm - 0.5 - 1e-9)))
    step_mm = inside_mm / (n + 0.5) if n else pitch_mm  # the innermost ring is half as wide
    rings: list[BaseGeometry] = []
    for k in range(n, -1, -1):
        for line in shapely.get_parts(shapely.boundary(offset(region, -k * step_mm))):
            rings += [ring for ring in shapely.get_parts(line) if ring.length > SHORTEST_MM]
    return [ring.simplify(CHORD_MM) for ring in rings], step_mm


def _between(region: BaseGeometry, rings: list[BaseGeometry], step_mm: float) -> list[BaseGeometry]:
    """Return lines round the places that the rings leave out, along ridges of the distance."""
    reach = 0.5 * step_mm * MARGIN
    left = region.difference(shapely.union_all(rings).buffer(reach, quad_segs=8))
    parts = [p for p in shapely.get_parts(left) if not p.buffer(-CHORD_MM).is_empty]
    return [LineString(p.exterior.coords).simplify(CHORD_MM) for p in parts]


def _pieces(lines: BaseGeometry) -> Iterator[Floats]:
    """Yield the lines (n, 2) of an intersection, pieces that go on in one another joined."""
    whole = shapely.line_merge(lines) if lines.geom_type == "MultiLineString" else lines
    for piece in shapely.get_parts(whole):
        if piece.length > SHORTEST_MM:
            yield np.asarray(shapely.get_coordinates(piece))
