"""Bone between both boundaries as it was mapped, and as it may be, ready to be looked up."""

import numpy as np
from scipy.ndimage import distance_transform_edt

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.cell_grid import CellGrid
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.planning.placement.inner_boundary import InnerBoundary

LEAST_DRAWS = 50  # fewer do not tell the spread of their lower half


class MappedBone:
    """Maps of both boundaries and draws of them, over one grid."""

    def __init__(self, maps: Maps, outer_draws_mm: Floats, inner_draws_mm: Floats) -> None:
        """Look at maps and their draws.

        Args:
            maps: Both boundaries.
            outer_draws_mm: Heights of the outer boundary as they may be (n, nu, nv).
            inner_draws_mm: Heights of the inner boundary in the same draws (n, nu, nv).

        Raises:
            InvalidInputError: the grids do not match, or there are too few draws.
        """
        _check(maps, outer_draws_mm, inner_draws_mm)
        self.outer, self.inner = maps.outer, maps.inner
        self.shape = maps.outer.height_mm.shape
        self.cell_mm = float(maps.outer.u_mm[1] - maps.outer.u_mm[0])
        origin_mm = np.array([maps.outer.u_mm[0], maps.outer.v_mm[0]])
        self.grid = CellGrid(readonly(origin_mm), self.cell_mm, self.shape)
        self.ok: Bools = maps.outer.ok & maps.inner.ok
        self.draws = len(inner_draws_mm)
        self.inner_boundary = InnerBoundary(maps.inner, self.grid, inner_draws_mm)
        padded = np.pad(self.ok, 1)  # beyond the grid nothing is mapped
        self.unmapped_mm = self.cell_mm * np.asarray(distance_transform_edt(padded))[1:-1, 1:-1]
        # a row for each cell: the heights of a place in all draws then lie side by side
        self.outer_draws = np.ascontiguousarray(outer_draws_mm.reshape(self.draws, -1).T)

    def places_mm(self) -> Floats:
        """Return u and v (nu, nv, 2) of every cell."""
        return np.stack(np.meshgrid(self.outer.u_mm, self.outer.v_mm, indexing="ij"), axis=-1)

    def outer_at(self, places_mm: Floats) -> Floats:
        """Return the outer map at places (..., 2), bilinearly."""
        corner, share = self.grid.corners(places_mm)
        u, v, columns = share[..., 0], share[..., 1], self.shape[1]
        first, height = corner[..., 0] * columns + corner[..., 1], self.outer.height_mm.ravel()
        low = (1 - v) * height[first] + v * height[first + 1]
        high = (1 - v) * height[first + columns] + v * height[first + columns + 1]
        return (1 - u) * low + u * high

    def covered(self, places_mm: Floats) -> Bools:
        """Return which places (..., 2) lie among four cells where both boundaries are mapped."""
        corner, share = self.grid.corners(places_mm)
        i, j = np.moveaxis(corner, -1, 0)
        among = self.ok[i, j] & self.ok[i + 1, j] & self.ok[i, j + 1] & self.ok[i + 1, j + 1]
        return among & ((share > -1e-9) & (share < 1.0 + 1e-9)).all(axis=-1)


def _check(maps: Maps, outer_draws_mm: Floats, inner_draws_mm: Floats) -> None:
    shape = maps.outer.height_mm.shape
    require(
        _grid(maps.outer) == _grid(maps.inner),
        f"the outer map has {shape} cells and the inner one {maps.inner.height_mm.shape}, or they "
        "lie elsewhere: make both maps on one grid",
    )
    require(min(shape) >= 3, f"a map of {shape} cells is too small for a bed")
    for name, draws in (("outer", outer_draws_mm), ("inner", inner_draws_mm)):
        require(
            draws.ndim == 3 and draws.shape[1:] == shape,
            f"draws of the {name} map are {draws.shape}, not (n, {shape[0]}, {shape[1]})",
        )
        require(bool(np.isfinite(draws).all()), f"draws of the {name} map must be finite")
    count = len(inner_draws_mm)
    require(
        len(outer_draws_mm) == count,
        f"{len(outer_draws_mm)} draws of the outer map and {count} of the inner one: draw both",
    )
    require(count >= LEAST_DRAWS, f"{count} draws are too few: at least {LEAST_DRAWS} are needed")


def _grid(boundary: BoundaryMap) -> tuple[object, ...]:
    """Return what two maps have in common that lie on one grid."""
    return (
        boundary.u_mm.tolist(),
        boundary.v_mm.tolist(),
        boundary.T_base_map.matrix().tolist(),
        boundary.height_mm.shape,
    )
