"""Ray casting on a triangle mesh: distance to the first hit."""

from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from trimesh.ray import ray_pyembree

from rona_core.errors import DeviceError, InvalidInputError
from rona_core.geometry.arrays import Floats, as_points, as_unit_vectors
from rona_core.geometry.mesh import Mesh


class MeshRaycaster:
    """Rays on one mesh, in the frame of the mesh (Embree through trimesh, single precision)."""

    def __init__(self, mesh: Mesh) -> None:
        """Prepare the mesh.

        Raises:
            InvalidInputError: no triangles, or faces that name vertices that are not there.
            DeviceError: Embree is not installed; without it rays are a thousand times slower.
        """
        vertices = as_points(mesh.vertices, at_least=3, name="vertices")
        faces = np.asarray(mesh.faces)
        if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
            raise InvalidInputError(f"a mesh to cast rays on needs triangles, got {faces.shape}")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InvalidInputError(
                f"faces name vertices {faces.min()} to {faces.max()}, but there are {len(vertices)}"
            )
        if not ray_pyembree_works():
            raise DeviceError("casting rays needs Embree: install the package 'embreex'")
        self._triangles = vertices[faces]
        normals = np.cross(
            self._triangles[:, 1] - self._triangles[:, 0],
            self._triangles[:, 2] - self._triangles[:, 0],
        )
        self._normals = normals
        solid = trimesh.Trimesh(vertices, faces, process=False, validate=False)
        caster: Any = ray_pyembree.RayMeshIntersector
        self._caster = caster(solid)

    def first_hit(
        self, origins: ArrayLike, directions: ArrayLike, least_cosine: float = 0.0
    ) -> Floats:
        """Return the distance (n,) in mm to the first triangle along each ray, inf where missed.

        Args:
            origins: Start points (n, 3).
            directions: Unit vectors (n, 3).
            least_cosine: A ray that meets the first triangle at a smaller one to its normal, nearly
                along it, counts as missed.
        """
        o = as_points(origins, name="origins")
        d = as_unit_vectors(directions, name="directions")
        if len(o) != len(d):
            raise InvalidInputError(f"{len(o)} origins need as many directions, not {len(d)}")
        distances = np.full(len(o), np.inf)
        if not len(o):
            return distances
        faces = np.asarray(self._caster.intersects_first(o, d))
        rays = np.flatnonzero(faces >= 0)
        normals, corners = self._normals[faces[rays]], self._triangles[faces[rays], 0]
        slope = np.einsum("ij,ij->i", normals, d[rays])
        offset = np.einsum("ij,ij->i", normals, corners - o[rays])
        level = np.abs(slope) > max(1e-12, least_cosine) * np.linalg.norm(normals, axis=1)
        rays, t = rays[level], offset[level] / slope[level]  # in double precision, on the plane
        distances[rays] = np.maximum(t, 0.0)
        return distances


def ray_pyembree_works() -> bool:
    """Return whether trimesh found Embree."""
    return bool(trimesh.ray.has_embree)
