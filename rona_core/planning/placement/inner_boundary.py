"""The inner boundary in the map and in its draws, ready to be looked up at any place."""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.cell_grid import CellGrid, cosines, refined_field
from rona_core.mapping.boundary_map import BoundaryMap

AT_ONCE = 20  # draws that are refined together: all of them take twelve times their own memory


class InnerBoundary:
    """Heights, slopes and draws of the inner boundary over a grid of half the cells of the map.

    Halfway between the cells of the map stands what a cubic through them has; between these it is
    linear. Linear from cell to cell it would cut off crests, where a bed leaves the least bone.

    Attributes:
        grid: Of what follows.
        height_mm: Of the map (cells,).
        slopes: Of the map along u and v (cells, 2).
        cosine: Of a vertical distance to the boundary, what the shortest is (cells,).
        draws_mm: Heights as they may be (cells, draws): those of a place lie side by side.
    """

    def __init__(self, boundary: BoundaryMap, grid: CellGrid, draws_mm: Floats) -> None:
        """Put values between the cells of a map (nu, nv) and of its draws (n, nu, nv)."""
        self.grid = grid.refined()
        height = refined_field(boundary.height_mm, boundary.ok)
        slopes = self.grid.slopes(height)
        self.height_mm: Floats = height.ravel()
        self.slopes: Floats = slopes.reshape(-1, 2)
        self.cosine: Floats = cosines(self.slopes)
        self.draws_mm: Floats = np.zeros((height.size, len(draws_mm)))
        for start in range(0, len(draws_mm), AT_ONCE):
            some = slice(start, start + AT_ONCE)
            finer = refined_field(draws_mm[some], boundary.ok)
            self.draws_mm[:, some] = finer.reshape(len(finer), -1).T

    def draws_at_cells_mm(self) -> Floats:
        """Return the draws at the cells of the map alone (nu nv, draws)."""
        u, v = self.grid.shape
        return self.draws_mm.reshape(u, v, -1)[::2, ::2].reshape((u + 1) // 2 * ((v + 1) // 2), -1)
