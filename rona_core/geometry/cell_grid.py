"""Even cells in a plane: fields over them looked up at any place, slopes, and a finer grid."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from rona_core.geometry.arrays import Bools, Floats, Ints


@dataclass(frozen=True, slots=True, eq=False)
class CellGrid:
    """Grid of even cells (nu, nv) along u and v, in mm."""

    origin_mm: Floats  # (2,) of the first cell
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

    def slopes(self, field: Floats) -> Floats:
        """Return how a field (nu, nv) changes along u and v (nu, nv, 2), per millimetre."""
        return np.stack([np.gradient(field, self.cell_mm, axis=axis) for axis in (0, 1)], axis=-1)

    def refined(self) -> "CellGrid":
        """Return the grid of half the cells, which has every cell of this one and one between."""
        finer = (2 * self.shape[0] - 1, 2 * self.shape[1] - 1)
        return CellGrid(self.origin_mm, 0.5 * self.cell_mm, finer)


def cosines(slopes: Floats) -> Floats:
    """Return the cosines (...) of the angle of planes with these slopes (..., 2) to the plane."""
    return np.asarray(1.0 / np.sqrt(1.0 + (slopes**2).sum(axis=-1)))


def refined_field(fields: Floats, ok: Bools) -> Floats:
    """Return fields (..., nu, nv) over the finer grid (..., 2 nu - 1, 2 nv - 1).

    Values between two neighbours by cubic convolution (Keys 1981). Cells that are not ``ok`` (nu,
    nv), or beyond the grid, lie on the line through the two next to them instead.
    """
    along_u = np.moveaxis(_refined(np.moveaxis(fields, -2, 0), ok), 0, -2)
    known = np.zeros((2 * len(ok) - 1, ok.shape[1]), dtype=np.bool_)
    known[::2], known[1::2] = ok, ok[:-1] & ok[1:]
    return np.moveaxis(_refined(np.moveaxis(along_u, -1, 0), known.T), 0, -1)


def _refined(old: Floats, ok: Bools) -> Floats:
    """Return values (n, ..., m) and those between them along the first axis; ``ok`` is (n, m)."""
    low, high = old[:-1], old[1:]
    before = np.concatenate((old[:1], old[:-2]))
    after = np.concatenate((old[2:], old[-1:]))
    no = np.zeros_like(ok[:1])
    shape = (len(low), *(1,) * (old.ndim - 2), ok.shape[1])
    used_before = np.concatenate((no, ok[:-2])).reshape(shape)
    used_after = np.concatenate((ok[2:], no)).reshape(shape)
    before = np.where(used_before, before, 2.0 * low - high)
    after = np.where(used_after, after, 2.0 * high - low)
    finer = np.zeros((2 * len(old) - 1, *old.shape[1:]))
    finer[::2], finer[1::2] = old, (9.0 * (low + high) - before - after) / 16.0
    return finer
