"""Chart of the simulated head: radii as cubic splines over a plane.

A point ``v`` from the centre has depth ``s = v.e0`` and slopes ``a = v.e1 / s``, ``b = v.e2 / s``
(the gnomonic map). Boundary k is ``v = rho_k(a, b) * (e0 + a e1 + b e2)``, so it is a height field
whose derivatives are short to write, and straight lines stay straight.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.virtual.specimen.bsplines import cubic_weights
from rona_core.virtual.specimen.simulated.spherical_fields import HEAD_MM

RIM = 8  # nodes beyond the patch, so that the end conditions of the splines have died away


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """Splines of the four boundaries over slopes within ``half`` of the axis of the patch."""

    axes: Floats  # (3, 3), rows e0, e1, e2
    half: float  # largest |a| and |b|
    step: float  # between nodes
    tiles: Floats  # (4 n, n) spline coefficients, one tile a boundary

    @classmethod
    def bake(
        cls, radii: Callable[[Floats], Floats], axes: Floats, half: float, step_mm: float
    ) -> "Chart":
        """Sample ``radii`` (directions (n, 3) -> (n, 4) mm) and fit the splines."""
        step = step_mm / HEAD_MM
        count = int(np.ceil(half / step)) + RIM
        slopes = np.arange(-count, count + 1) * step
        a, b = (grid.ravel() for grid in np.meshgrid(slopes, slopes, indexing="ij"))
        w = np.stack((np.ones_like(a), a, b), axis=1) @ axes
        lengths = np.linalg.norm(w, axis=1)
        rho = radii(w / lengths[:, None]) / lengths[:, None]
        n = len(slopes)
        tiles = [spline_filter(column.reshape(n, n), order=3) for column in rho.T]
        return cls(axes, half, step, np.concatenate(tiles))

    def locate(self, v: Floats) -> tuple[Floats, Bools]:
        """Return depth and slopes (3, n) of points ``v`` (n, 3), and whether the patch holds them.

        Only where it does are the slopes meaningful.
        """
        place = self.axes @ v.T
        held = place[0] > 1e-6
        place[1:] /= np.where(held, place[0], 1.0)
        held &= (np.abs(place[1]) <= self.half) & (np.abs(place[2]) <= self.half)
        return place, held

    def gap(self, v: Floats, place: Floats, k: Ints) -> Floats:
        """Return how far (n,) in mm the points ``v`` lie outside boundary ``k`` (n,), radially."""
        n = self.tiles.shape[1]
        rows = place[1] / self.step + (n - 1) / 2 + k * n
        columns = place[2] / self.step + (n - 1) / 2
        rho = map_coordinates(self.tiles, (rows, columns), order=3, prefilter=False)
        depth = np.maximum(place[0], 1e-9)  # the centre itself is inside everything
        return np.sqrt(np.einsum("ij,ij->i", v, v)) * (1.0 - rho / depth)

    def surface(self, slopes: Floats, k: int) -> tuple[Floats, Floats, Floats]:
        """Return points and their derivatives by the slopes.

        Args:
            slopes: (n, 2); clipped to the patch.
            k: Boundary.

        Returns:
            Points (n, 3) from the centre, first (n, 2, 3) and second (n, 2, 2, 3) derivatives.
        """
        n = self.tiles.shape[1]
        tile = self.tiles[k * n : (k + 1) * n]
        x = np.clip(slopes, -self.half, self.half) / self.step + (n - 1) / 2
        cell = np.floor(x).astype(np.int64)
        weights = cubic_weights(x - cell)  # (3 orders, n, 2, 4 nodes)
        reach = np.arange(-1, 3)
        nodes = tile[(cell[:, 0, None] + reach)[:, :, None], (cell[:, 1, None] + reach)[:, None, :]]
        wa, wb = weights[:, :, 0], weights[:, :, 1]

        def derived(i: int, j: int) -> Floats:
            rho = np.einsum("ni,nij,nj->n", wa[i], nodes, wb[j])
            return rho[:, None] / self.step ** (i + j)

        e0, e1, e2 = self.axes
        at = np.clip(slopes, -self.half, self.half)
        w = e0 + at[:, :1] * e1 + at[:, 1:] * e2
        rho, ra, rb = derived(0, 0), derived(1, 0), derived(0, 1)
        mixed = derived(1, 1) * w + ra * e2 + rb * e1
        first = np.stack((ra * w + rho * e1, rb * w + rho * e2), axis=1)
        aa, bb = derived(2, 0) * w + 2.0 * ra * e1, derived(0, 2) * w + 2.0 * rb * e2
        second = np.stack((np.stack((aa, mixed), 1), np.stack((mixed, bb), 1)), axis=1)
        return rho * w, first, second
