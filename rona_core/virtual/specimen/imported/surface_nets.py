"""Isosurface of a volume as a smooth triangle mesh: naive surface nets.

Each cell that the level crosses gets one vertex, the mean of the crossings of its edges; each grid
edge that crosses the level joins the vertices of the four cells around it.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints


def surface_nets(values: Floats) -> tuple[Floats, Ints]:
    """Return vertices (n, 3) in places of the grid and faces (m, 3) where ``values`` cross 0.

    Faces are counter-clockwise seen from where the values are positive. The border of the volume
    must be positive.
    """
    inside = values < 0.0
    cells = np.array(values.shape) - 1
    sums = np.zeros((*cells, 3))
    counts = np.zeros(cells, dtype=np.int64)
    crossings: list[tuple[int, Ints, Bools]] = []
    for axis in range(3):
        lower = [slice(None)] * 3
        upper = [slice(None)] * 3
        lower[axis], upper[axis] = slice(None, -1), slice(1, None)
        a, b = values[tuple(lower)], values[tuple(upper)]
        edges = np.argwhere(inside[tuple(lower)] != inside[tuple(upper)])
        i = tuple(edges.T)
        where = edges.astype(np.float64)
        where[:, axis] += a[i] / (a[i] - b[i])
        crossings.append((axis, edges, a[i] < 0.0))
        for da in (0, 1):
            for db in (0, 1):
                cell = edges.copy()
                cell[:, (axis + 1) % 3] -= da
                cell[:, (axis + 2) % 3] -= db
                held = ((cell >= 0) & (cell < cells)).all(axis=1)
                at = tuple(cell[held].T)
                np.add.at(sums, at, where[held])
                np.add.at(counts, at, 1)
    used = counts > 0
    numbers = np.full(cells, -1)
    numbers[used] = np.arange(int(used.sum()))
    vertices = sums[used] / counts[used][:, None]
    faces = []
    for axis, edges, leaving in crossings:
        quad = []
        for da, db in ((0, 0), (1, 0), (1, 1), (0, 1)):
            cell = edges.copy()
            cell[:, (axis + 1) % 3] -= da
            cell[:, (axis + 2) % 3] -= db
            held = ((cell >= 0) & (cell < cells)).all(axis=1)
            clipped = np.clip(cell, 0, cells - 1)
            quad.append(np.where(held, numbers[tuple(clipped.T)], -1))
        corners = np.stack(quad, axis=1)
        corners = np.where(leaving[:, None], corners, corners[:, ::-1])
        corners = corners[(corners >= 0).all(axis=1)]
        faces.append(np.concatenate((corners[:, (0, 1, 2)], corners[:, (0, 2, 3)])))
    return vertices, np.concatenate(faces).astype(np.int64)
