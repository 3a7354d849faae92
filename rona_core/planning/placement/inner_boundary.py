"""The inner boundary in the map and in its draws, over a grid half as wide as that of the map."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.mapping.boundary_map import BoundaryMap


@dataclass(frozen=True, slots=True, eq=False)
class CellGrid:
    """Even cells in the plane of a map, in mm."""

    origin_mm: Floats  # (2,) the first cell
    cell_mm: float
    shape: tuple[int, int]

    def corners(self, places_mm: Floats) -> tuple[Ints, Floats]:
        """Return the cells (..., 2) below places (..., 2), and how far beyond them (..., 2)."""
        cells = (places_mm - self.origin_mm) / self.cell_mm
        corner = np.clip(np.floor(cells), 0, np.array(self.shape) - 2).astype(np.int64)
        return corner, cells - corner

    def operator(self, places_mm: Floats) -> csr_matrix:
        """Return the matrix (n, nu nv) that takes a field to places (n, 2), bilinearly."""
        corner, share = self.corners(places_mm)
        (u, v), columns = share.T, self.shape[1]
        first = corner[:, 0] * columns + corner[:, 1]
        weights = np.stack(((1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v), axis=1)
        cells = first[:, None] + np.array((0, 1, columns, columns + 1))
        starts = 4 * np.arange(len(first) + 1)
        size = (len(first), self.shape[0] * columns)
        return csr_matrix((weights.ravel(), cells.ravel(), starts), shape=size)


class InnerBoundary:
    """Heights, slopes and draws of the inner boundary, ready to be looked up at any place.

    Halfway between the cells of the map stands what a cubic through them has; between these it is
    linear. Linear from cell to cell it would cut off crests, where a bed leaves the least bone.

    Attributes:
        height: Of the map (cells,).
        slopes: Of the map along u and v (cells, 2).
        cosine: Of a vertical distance to the boundary, what the shortest is (cells,).
        draws: Heights as they may be (cells, draws): those of a place lie side by side.
    """

    def __init__(self, boundary: BoundaryMap, draws_mm: Floats) -> None:
        """Put values between the cells of a map (nu, nv) and of its draws (n, nu, nv)."""
        height = _halved(_halved(boundary.height_mm, 0), 1)
        first, second = boundary.u_mm[:2].tolist()
        origin = np.array([first, boundary.v_mm[0]])
        self.grid = CellGrid(readonly(origin), 0.5 * (second - first), height.shape)
        inclined = slopes(height, self.grid.cell_mm)
        self.height: Floats = height.ravel()
        self.slopes: Floats = inclined.reshape(-1, 2)
        self.cosine: Floats = 1.0 / np.sqrt(1.0 + (self.slopes**2).sum(axis=1))
        finer = _halved(_halved(draws_mm, 1), 2)
        self.draws: Floats = np.ascontiguousarray(finer.reshape(len(draws_mm), -1).T)


def _halved(field: Floats, axis: int) -> Floats:
    """Return a field with a value between each two neighbours along an axis.

    By cubic convolution (Keys 1981); beyond its ends the field goes on along a line.
    """
    old = np.moveaxis(field, axis, 0)
    before, after = 2.0 * old[0] - old[1], 2.0 * old[-1] - old[-2]
    around = np.concatenate((before[None], old, after[None]))
    between = (9.0 * (old[:-1] + old[1:]) - around[:-3] - around[3:]) / 16.0
    finer = np.zeros((2 * len(old) - 1, *old.shape[1:]))
    finer[::2], finer[1::2] = old, between
    return np.moveaxis(finer, 0, axis)


def slopes(heights_mm: Floats, cell_mm: float) -> Floats:
    """Return how heights (nu, nv) change along u and v (nu, nv, 2), per millimetre."""
    return np.stack([np.gradient(heights_mm, cell_mm, axis=axis) for axis in (0, 1)], axis=-1)
