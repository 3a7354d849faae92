"""Concentric rings over a region: every place of it is within half a pitch of one of them."""

from collections.abc import Iterator

import numpy as np
import shapely
from shapely.geometry import LineString
from shapely.geometry.base import BaseGeometry

from rona_core.geometry.arrays import Floats
from rona_core.planning.milling.burr import Burr
from rona_core.planning.milling.tool_regions import Level, inner_radius_mm, offset

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
