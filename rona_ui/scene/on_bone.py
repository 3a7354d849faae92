"""Places on the drawn skull: what was measured on the bone stands on it and not within."""

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats
from rona_core.geometry.mesh import Mesh
from rona_core.session.memo import Memo
from rona_ui.presentation.static_scene import StaticScene

FAR_MM = 15.0  # from the skull: such a place is not on it
_TREES: Memo[KDTree] = Memo(2)
_NORMALS: Memo[Floats] = Memo(2)


def on_bone(points_base: Floats, scene: StaticScene | None, height_mm: float) -> Floats:
    """Return points (n, 3) in ``base``, raised to a height over the drawn skull where below it.

    Measured points scatter about the bone, and a dot that lies within it is half hidden. Points
    that are as high already, or far from the skull, stay where they are.
    """
    if scene is None or not len(points_base) or not len(scene.skull.vertices):
        return points_base
    vertices = scene.skull.vertices
    tree, normals = _TREES.get((scene.skull,), lambda: KDTree(vertices)), skull_normals(scene.skull)
    if normals[tree.query(scene.region_center_base)[1]] @ scene.region_normal_base < 0.0:
        normals = -normals  # a skull whose triangles are counted the other way round
    apart, nearest = tree.query(points_base)
    normals = normals[nearest]
    heights = np.einsum("ij,ij->i", points_base - vertices[nearest], normals)
    below = np.where(apart < FAR_MM, np.maximum(height_mm - heights, 0.0), 0.0)
    return points_base + below[:, None] * normals


def skull_normals(skull: Mesh) -> Floats:
    """Return the outward normal (n, 3) at each vertex of a drawn skull."""
    return _NORMALS.get((skull,), lambda: _normals(skull))


def _normals(skull: Mesh) -> Floats:
    a, b, c = (skull.vertices[skull.faces[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)
    total = np.zeros_like(skull.vertices)
    for corner in skull.faces.T:
        for axis in range(3):
            total[:, axis] += np.bincount(corner, areas[:, axis], len(total))
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-12)[:, None]
