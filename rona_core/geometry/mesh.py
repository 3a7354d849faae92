"""Triangle meshes, and surface nets, which make one of a field.

Surface nets (Gibson 1998, see docs/references.md): the surface where a field changes its sign. One
vertex for each cube of eight grid points that the surface passes, at the mean of its crossings with
the edges; one quadrangle for each edge of the grid that it crosses.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Bools, Floats, Ints


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A triangle mesh: vertices (n, 3) in mm, faces (m, 3)."""

    vertices: Floats
    faces: Ints


Reals = NDArray[np.floating[Any]]
CORNERS = tuple(np.ndindex(2, 2, 2))


def surface_nets(values: Reals, known: Bools | None = None) -> tuple[Floats, Ints]:
    """Return the surface where values (a, b, c) change their sign: points (n, 3) and faces (m, 3).

    Points are in steps of the grid. Faces are counter-clockwise seen from where values are
    negative. Cubes with a corner that is not known have no point: there, and at the border, the
    surface is open.
    """
    inside = values > 0.0
    shape = tuple(n - 1 for n in values.shape)
    corners = [tuple(slice(k, k + n) for k, n in zip(c, shape, strict=True)) for c in CORNERS]
    count = np.zeros(shape, dtype=np.int8)
    for corner in corners:
        count += inside[corner]
    cubes = (count > 0) & (count < len(CORNERS))
    if known is not None:
        cubes &= np.logical_and.reduce([known[corner] for corner in corners])
    number = np.full(shape, -1, dtype=np.int64)
    number[cubes] = np.arange(np.count_nonzero(cubes))
    points = np.argwhere(cubes) + _mean_crossings(values, cubes)
    return points, np.concatenate([_faces(inside, number, axis) for axis in range(3)])


def _mean_crossings(values: Reals, cubes: Bools) -> Floats:
    """Return the mean (n, 3), 0 to 1, of where in its cube the twelve edges are crossed."""
    at = np.argwhere(cubes)
    total, number = np.zeros((len(at), 3)), np.zeros((len(at), 1))
    for axis in range(3):
        step = np.eye(3, dtype=np.int64)[axis]
        for corner in (np.array(c) for c in CORNERS if c[axis] == 0):
            first, last = (values[tuple((at + corner + k * step).T)] for k in (0, 1))
            crossed = (first > 0.0) != (last > 0.0)
            fall = np.where(crossed, first - last, 1.0)
            place = corner + (first / fall)[:, None] * step
            total += np.where(crossed[:, None], place, 0.0)
            number += crossed[:, None]
    return total / number


def _faces(inside: Bools, number: Ints, axis: int) -> NDArray[np.int64]:
    """Return two triangles (m, 3) for each edge along an axis that is crossed amid four cubes."""
    turned = np.moveaxis(inside, axis, 0)  # the edge, then two axes that follow it cyclically
    cube = np.moveaxis(number, axis, 0)
    if axis == 1:  # (b, a, c): so that the three axes stay right-handed
        turned, cube = turned.transpose(0, 2, 1), cube.transpose(0, 2, 1)
    first, last = turned[:-1, 1:-1, 1:-1], turned[1:, 1:-1, 1:-1]
    a, b = cube[:, :-1, :-1], cube[:, 1:, :-1]
    c, d = cube[:, 1:, 1:], cube[:, :-1, 1:]
    whole = (a >= 0) & (b >= 0) & (c >= 0) & (d >= 0)
    found: list[Ints] = []
    for leaves, order in ((True, (a, b, c, d)), (False, (d, c, b, a))):
        crossed = whole & (first != last) & (first == leaves)
        p, q, r, s = (corner[crossed] for corner in order)
        found += [np.column_stack((p, q, r)), np.column_stack((p, r, s))]
    return np.concatenate(found)
