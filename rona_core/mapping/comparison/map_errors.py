"""Errors of the maps against a reference, cell by cell, and their figures.

A boundary is compared along the normal of the map: positive where the map lies outside the
reference. The thickness is compared along that normal, and as the way to the nearest point of the
other boundary; positive where the map has more bone.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.surface.raycast import MeshRaycaster
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.comparison.reference_bone import ReferenceBone
from rona_core.mapping.files.map_mesh import cell_triangles

REACH_MM = 10.0  # beyond it a surface is another one
LEAST_COSINE = 0.5  # between ray and normal: a side wall of a cut-out plate is no table of bone
NAMES = ("outer", "fused", "inner", "thickness", "thickness_nearest")


@dataclass(frozen=True, slots=True, eq=False)
class MapErrors:
    """Signed errors over the grid of the maps (nu, nv) by name, NaN where none is known."""

    errors_mm: dict[str, Floats]

    def __post_init__(self) -> None:
        for values in self.errors_mm.values():
            readonly(values)


@dataclass(frozen=True, slots=True)
class ErrorFigures:
    """Figures of one map against a reference."""

    name: str
    cells: int  # that are mapped
    coverage: float  # share of them for which the reference has an answer
    bias_mm: float | None  # mean; None without an answer
    rms_mm: float | None
    spread_mm: float | None  # RMS about the mean
    p95_mm: float | None  # of the size
    stated_mm: float | None = None  # RMS of the standard deviation that the map states there


def compare_with_bone(maps: Maps, bone: ReferenceBone) -> MapErrors:
    """Return the errors of the maps against surfaces in ``base``.

    The outer table is met from outside, the inner one from inside, so that one closed mesh serves
    for both.

    Raises:
        DegenerateGeometryError: nothing of the reference lies within reach of the map.
    """
    outer = MeshRaycaster(bone.outer)
    errors = {
        "outer": _over(maps.outer, maps.outer.ok, _outer_errors(maps.outer, outer)),
        "fused": _over(maps.fused, maps.fused.ok, _outer_errors(maps.fused, outer)),
    }
    if bone.inner is not None:
        inner = MeshRaycaster(bone.inner)
        points, normals = surface_cells(maps.inner, maps.inner.ok)
        met = inner.first_hit(points - REACH_MM * normals, normals, LEAST_COSINE)
        errors["inner"] = _over(maps.inner, maps.inner.ok, _within(REACH_MM - met))
        errors |= _thickness_errors(maps, outer, inner)
    if not any(np.isfinite(values).any() for values in errors.values()):
        raise DegenerateGeometryError(
            f"nothing of the reference lies within {REACH_MM:g} mm of the maps: is it in the frame "
            "of the robot's base? If not, register it"
        )
    return MapErrors(errors)


def figures_of(
    maps: Maps, found: MapErrors, stated_mm: dict[str, Floats] | None = None
) -> tuple[ErrorFigures, ...]:
    """Return the figures of each map; ``stated_mm`` holds its standard deviations (nu, nv)."""
    both = maps.inner.ok & maps.outer.ok
    mapped = {"outer": maps.outer.ok, "fused": maps.fused.ok, "inner": maps.inner.ok}
    rows: list[ErrorFigures] = []
    for name in NAMES:
        if name not in found.errors_mm:
            continue
        cells, errors = mapped.get(name, both), found.errors_mm[name]
        known = cells & np.isfinite(errors)
        row = _figures(name, int(cells.sum()), errors[known])
        stated = (stated_mm or {}).get(name)
        if stated is not None and known.any() and np.isfinite(stated[known]).all():
            row = replace(row, stated_mm=float(np.sqrt(np.mean(stated[known] ** 2))))
        rows.append(row)
    return tuple(rows)


def _figures(name: str, cells: int, errors: Floats) -> ErrorFigures:
    share = len(errors) / cells if cells else 0.0
    if not len(errors):
        return ErrorFigures(name, cells, share, None, None, None, None)
    return ErrorFigures(
        name,
        cells,
        share,
        bias_mm=float(errors.mean()),
        rms_mm=float(np.sqrt(np.mean(errors**2))),
        spread_mm=float(errors.std()),
        p95_mm=float(np.percentile(np.abs(errors), 95.0)),
    )


def surface_cells(boundary: BoundaryMap, which: Bools) -> tuple[Floats, Floats]:
    """Return points (n, 3) and outward normals (n, 3) of some cells of a map, in ``base``."""
    u, v = boundary.u_mm, boundary.v_mm
    slopes = [
        np.gradient(boundary.height_mm, axis, axis=k) if len(axis) > 1 else np.zeros(which.shape)
        for k, axis in enumerate((u, v))
    ]
    i, j = np.nonzero(which)
    points = np.column_stack((u[i], v[j], boundary.height_mm[which]))
    normals = np.column_stack((-slopes[0][which], -slopes[1][which], np.ones(len(i))))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return boundary.T_base_map @ points, boundary.T_base_map.rotate(normals)


def _outer_errors(boundary: BoundaryMap, outer: MeshRaycaster) -> Floats:
    points, normals = surface_cells(boundary, boundary.ok)
    return _within(outer.first_hit(points + REACH_MM * normals, -normals, LEAST_COSINE) - REACH_MM)


def _thickness_errors(maps: Maps, outer: MeshRaycaster, inner: MeshRaycaster) -> dict[str, Floats]:
    """Return the errors of the thickness along the normal and to the nearest point."""
    both = maps.inner.ok & maps.outer.ok
    nothing = np.full(both.shape, np.nan)
    try:
        triangles = cell_triangles(maps.inner.ok)
    except DegenerateGeometryError:
        return {"thickness": nothing, "thickness_nearest": nothing}
    own_inner = MeshRaycaster(Mesh(surface_cells(maps.inner, np.ones_like(both))[0], triangles))
    points, normals = surface_cells(maps.outer, both)
    depth = own_inner.first_hit(points, -normals)
    seen = np.isfinite(depth)
    points, normals, depth = points[seen], normals[seen], depth[seen]
    # by how much each boundary of the map lies outside that of the reference
    above = _within(outer.first_hit(points + REACH_MM * normals, -normals, LEAST_COSINE) - REACH_MM)
    below = _within(
        REACH_MM
        - inner.first_hit(points - (depth + REACH_MM)[:, None] * normals, normals, LEAST_COSINE)
    )
    known = np.isfinite(above) & np.isfinite(below)
    above, below, depth = above[known], below[known], depth[known]
    p, n = points[known], normals[known]
    rows = np.flatnonzero(both.ravel())[seen][known]
    along, nearest = nothing.copy(), nothing.copy()
    along.ravel()[rows] = above - below
    if len(rows):
        own = _nearest_mm(p, p - depth[:, None] * n)
        there = _nearest_mm(p - above[:, None] * n, p - (depth + below)[:, None] * n)
        nearest.ravel()[rows] = own - there
    return {"thickness": along, "thickness_nearest": nearest}


def _nearest_mm(outer: Floats, inner: Floats) -> Floats:
    """Return the ways (n,) from outer points (n, 3) to the nearest of inner points (n, 3)."""
    return np.asarray(KDTree(inner).query(outer)[0], dtype=np.float64)


def _within(errors: Floats) -> Floats:
    return np.where(np.abs(errors) <= REACH_MM, errors, np.nan)


def _over(boundary: BoundaryMap, which: Bools, values: Floats) -> Floats:
    grid = np.full(boundary.height_mm.shape, np.nan)
    grid[which] = values
    return grid
