"""Sphere mesh of nearly equal triangles: the six faces of a cube, projected."""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints


def cube_sphere(n: int) -> tuple[Ints, Floats]:
    """Return faces (12 n^2, 3), seen counter-clockwise from outside, and unit vertices (m, 3).

    Args:
        n: Cells along each edge of the cube.
    """
    tan = np.tan(np.linspace(-np.pi / 4.0, np.pi / 4.0, n + 1))  # equal angles, not equal steps
    a, b = (grid.ravel() for grid in np.meshgrid(tan, tan, indexing="ij"))
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.stack((corner, corner + n + 1, corner + n + 2, corner + 1), axis=1)
    vertices, faces = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            v = np.zeros((len(a), 3))
            v[:, axis], v[:, (axis + 1) % 3], v[:, (axis + 2) % 3] = sign, a, b
            cells = quads if sign > 0 else quads[:, ::-1]
            offset = len(vertices) * len(a)
            faces.append(np.concatenate((cells[:, (0, 1, 2)], cells[:, (0, 2, 3)])) + offset)
            vertices.append(v)
    points = np.concatenate(vertices)
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    _, first, merged = np.unique(
        np.round(unit, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    return merged.ravel()[np.concatenate(faces)].astype(np.int64), unit[first]
