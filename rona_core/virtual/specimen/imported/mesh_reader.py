"""Reader of bone meshes: inside test and distance of closed triangle surfaces."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import KDTree
from trimesh.remesh import subdivide_to_size
from trimesh.triangles import closest_point

from rona_core.devices.files.size_limits import open_file
from rona_core.devices.files.triangle_file import read_triangles
from rona_core.devices.files.voxels.refusals import refused
from rona_core.geometry.arrays import Bools, Floats, Ints

EXTENT_MM = (40.0, 600.0)  # of a skull
FINE_MM = 1.5  # longest edge when nearest triangles are searched by their centres
NEAREST = 10  # triangles tried for each point
JITTER_MM = 0.0137  # moves rays off edges, which they would hit twice
TRIES = 4
CHUNK = 100_000
MOST_FINE = 4_000_000  # triangles after the long ones were cut
COLUMNS = 8192  # of rays at once
UNITS_MM = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4, "micrometres": 0.001}
TOUCHING_MM = 0.05  # surfaces that cross by less only touch
DEEPEST_MM = 60.0  # that a surface is looked for beyond another
MOST_TRIED = 2000  # places whose depth is measured


@dataclass(frozen=True, slots=True, eq=False)
class BoneMesh:
    """Closed surfaces; a place is bone where a ray from it crosses them an odd number of times."""

    vertices: Floats  # (n, 3) in skull
    faces: Ints  # (m, 3)

    def bounds(self) -> Floats:
        """Return the lowest and the highest corner (2, 3)."""
        return np.stack((self.vertices.min(axis=0), self.vertices.max(axis=0)))


def read_mesh(path: Path) -> BoneMesh:
    """Read one closed mesh; its sheets may touch along edges.

    Raises:
        InvalidInputError: damaged, foreign or empty, not closed, or not of the size of a skull.
    """
    kind = path.suffix[1:].upper()
    with open_file(path, f"a mesh ({kind})"):
        mesh = read_triangles(path, path.name)
    vertices, faces = mesh.vertices, mesh.faces
    extent = vertices.max(axis=0) - vertices.min(axis=0)
    low, high = EXTENT_MM
    if extent.max() < low or extent.max() > high:
        size = float(extent.max())
        units = [name for name, mm in UNITS_MM.items() if low <= size * mm <= high]
        hint = f"; it looks like {units[0]}" if units else ""
        raise refused(
            "a mesh of another size",
            name=path.name,
            extent=extent.round(2).tolist(),
            low=low,
            high=high,
            hint=hint,
        )
    sides = np.sort(faces[:, (0, 1, 1, 2, 2, 0)].reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    # where two sheets touch along an edge it has four triangles: in and out are still distinguished
    if (odd := int((count % 2).sum())) > 0:
        raise refused("an open mesh", name=path.name, odd=odd, count=len(edges))
    return BoneMesh(vertices, faces)


def joined(outer: BoneMesh, inner: BoneMesh) -> BoneMesh:
    """Return the bone between an outer and an inner surface.

    Raises:
        InvalidInputError: the inner surface lies outside the outer one, or crosses it.
    """
    for surface, other, within in ((inner, outer, True), (outer, inner, False)):
        # middles of the triangles too: a large one may cross with its corners on the right side
        places = np.concatenate((surface.vertices, surface.vertices[surface.faces].mean(axis=1)))
        wrong = places[_holds(other, places) != within]
        if not len(wrong):
            continue
        depth = distance_to(other, wrong[:: max(1, len(wrong) // MOST_TRIED)], DEEPEST_MM, np.inf)
        worst = int(depth.argmax())
        if depth[worst] < TOUCHING_MM:
            continue
        if len(wrong) > 0.5 * len(places):
            raise refused("an inner surface outside the outer one")
        raise refused(
            "an inner surface that crosses the outer one",
            count=len(wrong),
            places=len(places),
            depth_mm=depth[worst],
            place=wrong[:: max(1, len(wrong) // MOST_TRIED)][worst].round(1).tolist(),
        )
    faces = np.concatenate((outer.faces, inner.faces + len(outer.vertices)))
    return BoneMesh(np.concatenate((outer.vertices, inner.vertices)), faces)


def _holds(mesh: BoneMesh, places: Floats) -> Bools:
    """Return which places (n, 3) lie inside a closed surface."""
    return inside(mesh, places, np.array((0.0, 0.0, 1.0)), 1)[:, 0]


def inside(mesh: BoneMesh, origins: Floats, step: Floats, count: int) -> Bools:
    """Return which nodes of parallel columns are bone, by counting crossings.

    Args:
        mesh: Closed surfaces.
        origins: First node of each column, (n, 3).
        step: From node to node, (3,) in mm.
        count: Nodes in each column.

    Returns:
        (n, count).

    Raises:
        InvalidInputError: columns that cross the surface an odd number of times.
    """
    solid: Any = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False, validate=False)
    spacing = float(np.linalg.norm(step))
    d = step / spacing
    far = (
        float(np.linalg.norm(np.ptp(mesh.bounds(), axis=0)))
        + np.abs((origins - mesh.vertices.mean(axis=0)) @ d).max()
    )
    parts: list[Bools] = []
    odd = 0
    for first in range(0, len(origins), COLUMNS):
        some, left = _crossed(solid, origins[first : first + COLUMNS], d, far, spacing, count)
        parts.append(some)
        odd += left
    if odd:
        raise refused("surfaces that cross themselves", odd=odd, count=len(origins))
    return np.concatenate(parts)


def _crossed(
    solid: Any, origins: Floats, d: Floats, far: float, spacing: float, count: int
) -> tuple[Bools, int]:
    """Return which nodes (n, count) of columns along ``d`` are bone, and how many stay odd."""
    across = np.linalg.svd(d[None])[2][1:]
    result = np.zeros((len(origins), count), dtype=np.bool_)
    open_columns = np.arange(len(origins))
    for attempt in range(TRIES):
        shift = (attempt + 1) * JITTER_MM * (across[0] + 0.618 * across[1])
        starts = origins[open_columns] + shift - far * d
        places, rays, _ = solid.ray.intersects_location(
            starts, np.repeat(d[None], len(starts), axis=0), multiple_hits=True
        )
        odd = np.bincount(rays, minlength=len(starts)) % 2 == 1
        t = np.einsum("ij,j->i", places - starts[rays], d) - far
        node = np.clip(np.ceil(t / spacing), 0, count).astype(np.int64)  # first node beyond
        crossings = np.zeros((len(starts), count + 1), dtype=np.int64)
        np.add.at(crossings, (rays, node), 1)
        result[open_columns] = np.cumsum(crossings, axis=1)[:, :count] % 2 == 1
        open_columns = open_columns[odd]
        if not len(open_columns):
            break
    return result, len(open_columns)


def _check_fine(corners: Floats) -> None:
    """Refuse triangles (n, 3, 3) that would be cut into too many; each cut halves the edges."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    cuts = np.ceil(np.log2(np.maximum(longest / FINE_MM, 1.0)))
    count = float((4.0**cuts).sum())
    if count > MOST_FINE:
        raise refused(
            "too many triangles",
            count=len(corners),
            edge=FINE_MM,
            millions=count / 1e6,
            most=MOST_FINE / 1e6,
        )


def distance_to(mesh: BoneMesh, points: Floats, limit_mm: float, exact_mm: float) -> Floats:
    """Return the distance (n,) from points to the surface, at most ``limit_mm``.

    Exact within ``exact_mm``; beyond, the distance to the nearest of many points on the surface.
    """
    low, high = points.min(axis=0) - limit_mm, points.max(axis=0) + limit_mm
    corners = mesh.vertices[mesh.faces]
    near = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
    if not near.any():
        return np.full(len(points), limit_mm)
    _check_fine(corners[near])
    fine: Any = subdivide_to_size(mesh.vertices, mesh.faces[near], FINE_MM, max_iter=14)
    triangles: Floats = fine[0][fine[1]]
    centers = KDTree(triangles.mean(axis=1))
    distances, _ = centers.query(points, distance_upper_bound=limit_mm)
    distances = np.minimum(distances, limit_mm)
    close = np.flatnonzero(distances < exact_mm + FINE_MM)
    nearest = min(NEAREST, len(triangles))
    for rows in np.array_split(close, max(1, len(close) // CHUNK)):
        _, candidates = centers.query(points[rows], k=nearest)
        candidates = candidates.reshape(len(rows), nearest)
        p = np.repeat(points[rows], nearest, axis=0)
        foot = closest_point(triangles[candidates.ravel()], p)
        off = np.linalg.norm(p - foot, axis=1).reshape(len(rows), nearest)
        distances[rows] = off.min(axis=1)
    return distances
