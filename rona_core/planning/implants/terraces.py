"""Terraces of an implant: what part of the plane it needs down to which depth.

An implant is laid in from above, so what it needs at one depth is the shadow of all of it that is
as deep or deeper. Regions get smaller downwards, and there is no undercut.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
import trimesh
from shapely.geometry.base import BaseGeometry

from rona_core.geometry.arrays import Floats
from rona_core.planning.implants.solids import ClosedMesh, Solid, Stack, solid_mesh

SLICE_MM = 0.1  # of a mesh: a slope between two slices counts as the wider of both
SNAP_MM = 1e-4  # ends of cut triangles that are this close are one


@dataclass(frozen=True, slots=True, eq=False)
class Terrace:
    """A region of the plane of ``bed`` that is needed from the terrace above down to a depth."""

    depth_mm: float
    region: BaseGeometry  # Polygon or MultiPolygon


def terraces(solid: Solid, lift_mm: float = 0.0) -> tuple[Terrace, ...]:
    """Return what a solid raised by ``lift_mm`` needs below z = 0, from the shallowest down."""
    found = _of_stack(solid, lift_mm) if isinstance(solid, Stack) else _of_mesh(solid, lift_mm)
    shadows: list[Terrace] = []
    for depth_mm, region in reversed(found):
        if shadows:
            region = shapely.union(region, shadows[-1].region)
        shadows.append(Terrace(depth_mm, region))
    return tuple(reversed(shadows))


def _of_stack(stack: Stack, lift_mm: float) -> list[tuple[float, BaseGeometry]]:
    parts = [part for part in stack.parts if part.to_mm - lift_mm > 0.0]
    return [(part.to_mm - lift_mm, part.region()) for part in parts]


def _of_mesh(solid: ClosedMesh, lift_mm: float) -> list[tuple[float, BaseGeometry]]:
    """Return for each slice of a mesh the union of its cuts just within both of its faces."""
    mesh = solid_mesh(solid, lift_mm)
    lowest_mm = -float(mesh.bounds[0][2])
    if lowest_mm <= 0.0:
        return []
    n = max(1, int(np.ceil(lowest_mm / SLICE_MM - 1e-9)))
    levels = np.linspace(0.0, lowest_mm, n + 1)
    within = 1e-3 * (levels[1] - levels[0])  # a cut in the plane of a face has no area
    found: list[tuple[float, BaseGeometry]] = []
    for above, below in pairwise(levels):
        both = _cut(mesh, above + within), _cut(mesh, below - within)
        found.append((float(below), shapely.union(*both)))
    return found


def _cut(mesh: Any, depth_mm: float) -> BaseGeometry:
    """Return the region that a plane across z cuts out of a closed mesh."""
    cut: Any = trimesh.intersections.mesh_plane(mesh, (0.0, 0.0, 1.0), (0.0, 0.0, -depth_mm))
    lines: Floats = cut
    if not len(lines):
        return shapely.Polygon()
    ends = np.round(lines[:, :, :2] / SNAP_MM) * SNAP_MM
    ends = ends[np.any(ends[:, 0] != ends[:, 1], axis=1)]
    sides: Any = shapely.linestrings(np.unique(ends, axis=0))
    faces = shapely.get_parts(shapely.polygonize(sides))
    if not len(faces):
        return shapely.Polygon()
    places = shapely.get_coordinates(shapely.point_on_surface(faces))
    at = np.column_stack((places, np.full(len(places), -depth_mm)))
    return shapely.union_all(faces[mesh.contains(at)])  # the face in a ring is a hole
