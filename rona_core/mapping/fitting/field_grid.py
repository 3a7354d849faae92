"""Grid that carries a field, what its nodes tell of places, and what bending it costs."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.cell_grid import CellGrid
from rona_core.mapping.fitting.banded_cholesky import BandedMatrix, FewBands

STEP_MM = 1.0  # between nodes
MOST_ACROSS = 120  # nodes across the shorter side: a wider field has larger steps
MARGIN_CELLS = 6  # the field goes on beyond the samples
STENCIL = ((0, 0), (0, 1), (0, 2), (1, -1), (1, 0), (1, 1), (2, 0))  # nodes that bending couples
ROWS = 2  # of the grid: bending couples each row to as many on either side


@dataclass(frozen=True)
class FieldGrid:
    """Nodes of a field (nu, nv), in mm; v is the shorter side."""

    u_mm: Floats  # (nu,) an even number
    v_mm: Floats  # (nv,)
    swapped: bool  # u of the field is v of the places

    @property
    def shape(self) -> tuple[int, int]:
        """Number of nodes."""
        return len(self.u_mm), len(self.v_mm)

    @property
    def step_mm(self) -> float:
        """Distance of neighbouring nodes."""
        return float(self.u_mm[1] - self.u_mm[0])

    def own(self, places_mm: Floats) -> Floats:
        """Return places (n, 2) along the axes of the field."""
        return places_mm[:, ::-1] if self.swapped else places_mm

    def operator(self, places_mm: Floats) -> csr_matrix:
        """Return the matrix (n, nu nv) that takes a field to places (n, 2), bilinearly."""
        first, last = ((self.u_mm[k], self.v_mm[k]) for k in (0, -1))
        grid = CellGrid(np.array(first), self.step_mm, self.shape)
        return grid.operator(np.clip(self.own(places_mm), first, last))

    def banded(self, matrix: csr_matrix) -> BandedMatrix:
        """Return a symmetric matrix over the nodes as its bands."""
        entries = matrix.tocoo()
        depth = entries.row - entries.col
        on = depth >= 0
        bands = np.zeros((ROWS * self.shape[1] + 1, self.shape[0] * self.shape[1]), order="F")
        bands[depth[on], entries.col[on]] = entries.data[on]
        return BandedMatrix(bands)


def grid_around(places_mm: Floats) -> FieldGrid:
    """Return the nodes of a field through places (n, 2), and a margin around them."""
    low, high = places_mm.min(axis=0), places_mm.max(axis=0)
    swapped = bool(high[1] - low[1] > high[0] - low[0])
    if swapped:
        low, high = low[::-1], high[::-1]
    step = max(STEP_MM, float(high[1] - low[1]) / MOST_ACROSS)
    first, last = np.floor(low / step) - MARGIN_CELLS, np.ceil(high / step) + MARGIN_CELLS
    counts = (last - first).astype(np.int64) + 1
    counts[0] += counts[0] % ROWS
    u, v = (step * (first[k] + np.arange(counts[k])) for k in range(2))
    return FieldGrid(readonly(u), readonly(v), swapped)


def bending(nu: int, nv: int, step_mm: float) -> FewBands:
    """Return the bending energy of fields over a grid, as precision of unit increments r² log r."""

    def squares(n: int, order: int) -> Floats:
        steps = np.diff(np.eye(n), order, axis=0)
        return steps.T @ steps

    def beside(matrix: Floats, apart: int) -> Floats:
        """Return the entries (n,) whose row is so much after their column, 0 where none is."""
        entries = np.diagonal(matrix, -apart)
        return np.pad(entries, (max(-apart, 0), max(apart, 0)))

    along, across = (squares(n, 2) for n in (nu, nv))
    twist_u, twist_v = (squares(n, 1) for n in (nu, nv))
    entries = np.zeros((len(STENCIL), nu, nv))
    for cells, (u, v) in zip(entries, STENCIL, strict=True):
        cells += 2.0 * np.multiply.outer(beside(twist_u, u), beside(twist_v, v))
        if v == 0:
            cells += beside(along, u)[:, None]
        if u == 0:
            cells += beside(across, v)
    entries *= 1.0 / (8.0 * np.pi * step_mm**2)
    depths = tuple(u * nv + v for u, v in STENCIL)
    return FewBands(depths, entries.reshape(len(STENCIL), -1))
