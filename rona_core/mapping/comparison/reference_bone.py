"""Reference bone: surfaces of the bone measured by other means, and their registration to ``base``.

A registration by surface takes away what the whole map is off by as a rigid body: what is left is
shape alone, and a common shift of the map can no longer be seen.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree
from trimesh.remesh import subdivide_to_size

from rona_core.calibration.surface_registration import (
    SurfaceRegistration,
    point_surface,
    register_surface,
)
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, as_points
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.geometry.rigid_fit import register_points
from rona_core.mapping.boundary_map import Maps

Registration = Literal["none", "points", "surface", "both"]

LEAST_MM, MOST_MM = 10.0, 600.0  # extent of a bone
EDGE_MM = 1.5  # of triangles whose centres stand for the surface in a registration
AROUND_MM = 15.0  # of the map within which they are taken
OUTWARD = 0.3  # cosine of normals that count as those of the outer table
MOST_POINTS = 2000  # of the map in a registration
MOST_TRIANGLES = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceBone:
    """Surfaces of one bone; a mesh that holds both tables, facing outwards, is given twice."""

    outer: Mesh
    inner: Mesh | None  # None where only the outer table is known

    def moved(self, T_b_a: Pose) -> "ReferenceBone":
        """Return it in another frame."""
        outer = Mesh(T_b_a @ self.outer.vertices, self.outer.faces)
        if self.inner is None or self.inner is self.outer:
            return ReferenceBone(outer, None if self.inner is None else outer)
        return ReferenceBone(outer, Mesh(T_b_a @ self.inner.vertices, self.inner.faces))


def bone_of_mesh(mesh: Mesh) -> ReferenceBone:
    """Return the bone that a mesh is the surface of: both tables if it is closed, else the outer.

    A mesh is closed if every edge has two triangles, or another even number.
    """
    sides = np.sort(mesh.faces[:, (0, 1, 1, 2, 2, 0)].reshape(-1, 2), axis=1)
    count = np.unique(sides, axis=0, return_counts=True)[1]
    return ReferenceBone(mesh, mesh if (count % 2 == 0).all() else None)


@dataclass(frozen=True, slots=True, eq=False)
class ReferencePlace:
    """Where a reference lies, and what its registration left over."""

    T_base_mesh: Pose
    points_rms_mm: float | None = None  # of named points
    points_off_mm: Floats | None = None  # (n,) each of them from its partner, by themselves
    surface: SurfaceRegistration | None = None


def place_reference(
    bone: ReferenceBone,
    maps: Maps,
    how: Registration = "none",
    pairs: tuple[ArrayLike, ArrayLike] | None = None,
) -> ReferencePlace:
    """Return the pose of a reference in ``base``.

    Args:
        bone: In the frame of its file.
        maps: Whose outer boundary it is laid under, where that is asked for.
        how: ``none`` takes it to be in ``base``; ``points`` by named points (Kabsch 1976);
            ``surface`` by the outer table from where it lies (Chen 1991), within about 10 degrees
            and 10 mm; ``both`` by the outer table from where the points lay it.
        pairs: Named points (n, 3) in the frame of the file and in ``base``, n >= 3.

    Raises:
        InvalidInputError: no points where they are needed, or not as many in both frames.
        DegenerateGeometryError: points on one line, or surfaces that do not lie on each other.
    """
    first = place_by_points(how, pairs)
    if how in ("none", "points"):
        return first
    found = _register_outer(bone, maps, first.T_base_mesh)
    return replace(first, T_base_mesh=found.T_b_a.inv(), surface=found)


def place_by_points(how: Registration, pairs: tuple[ArrayLike, ArrayLike] | None) -> ReferencePlace:
    """Return where a reference lies before surfaces are laid on each other; see above."""
    if how in ("none", "surface"):
        return ReferencePlace(Pose.identity())
    if pairs is None:
        raise InvalidInputError(f"a registration by {how} needs points in both frames: got none")
    fit = register_points(*pairs)
    return ReferencePlace(fit.T_b_a, fit.rms_mm, fit.residuals_mm)


def _register_outer(bone: ReferenceBone, maps: Maps, start: Pose) -> SurfaceRegistration:
    """Register the outer map to the outer table of a bone; ``T_b_a`` is of base in its frame."""
    cells = maps.outer.points_base()
    points = cells[:: max(1, len(cells) // MOST_POINTS)]
    T_mesh_base = start.inv()
    centres, normals = _centres(bone.outer, T_mesh_base @ points)
    out = T_mesh_base.rotate(maps.outer.T_base_map.rotation[:, 2][None])[0]
    facing = normals @ out
    if bone.inner is not bone.outer:  # an open sheet may be wound either way
        normals, facing = normals * np.sign(facing)[:, None], np.abs(facing)
    outward = facing > OUTWARD
    if not outward.any():
        raise DegenerateGeometryError(
            f"no surface of the reference lies within {AROUND_MM:g} mm of the map and faces as it "
            "does: expected the same bone in nearly the same place; register by points first"
        )
    surface = point_surface(centres[outward], normals[outward])
    return register_surface(points, surface, start=T_mesh_base)


def _centres(mesh: Mesh, about: Floats) -> tuple[Floats, Floats]:
    """Return centres (n, 3) and normals (n, 3) of small triangles near some points (m, 3)."""
    corners = mesh.vertices[mesh.faces]
    low, high = about.min(axis=0) - AROUND_MM, about.max(axis=0) + AROUND_MM
    near = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
    sides = corners[near] - corners[near][:, (1, 2, 0)]
    longest = np.linalg.norm(sides, axis=2).max(axis=1, initial=0.0)
    if np.sum(np.maximum(longest / EDGE_MM, 1.0) ** 2) > MOST_TRIANGLES:
        raise InvalidInputError(
            f"the reference has {int(near.sum())} triangles near the map, too many or too large: "
            "reduce the mesh, or cut it to the region of the map"
        )
    if not near.any():
        return np.zeros((0, 3)), np.zeros((0, 3))
    fine: Any = subdivide_to_size(mesh.vertices, mesh.faces[near], EDGE_MM, max_iter=14)
    triangles = np.asarray(fine[0], dtype=np.float64)[fine[1]]
    crossed = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(crossed, axis=1)
    centres = triangles.mean(axis=1)
    kept = (size > 0.0) & (KDTree(about).query(centres)[0] <= AROUND_MM)
    return centres[kept], crossed[kept] / size[kept, None]


def check_extent(mesh: Mesh, name: str) -> None:
    """Refuse a mesh that is not of the size of a bone, or holds none.

    Raises:
        InvalidInputError: no triangles, places that are not finite, or another unit than mm.
    """
    as_points(mesh.vertices, at_least=3, name=f"vertices of {name}")
    if not len(mesh.faces):
        raise InvalidInputError(f"{name} holds no triangles: expected the surface of a bone")
    extent = np.ptp(mesh.vertices, axis=0).max()
    if not LEAST_MM <= extent <= MOST_MM:
        raise InvalidInputError(
            f"{name} measures {extent:.3g}: expected {LEAST_MM:g} to {MOST_MM:g} mm of bone; check "
            "the unit"
        )
