"""Cubic B-splines on a regular grid: the weights of the four nodes around a place."""

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from rona_core.arrays import Floats


def cubic_weights(t: Floats) -> Floats:
    """Return weights of four nodes and their first and second derivatives, (3, *t, 4).

    Args:
        t: Place between the second and the third node, 0 to 1, any shape.
    """
    one = 1.0 - t
    value = (one**3, 3 * t**3 - 6 * t**2 + 4, 3 * one**3 - 6 * one**2 + 4, t**3)
    slope = (-(one**2) / 2, 1.5 * t**2 - 2 * t, -1.5 * one**2 + 2 * one, t**2 / 2)
    bend = (one, 3 * t - 2, 3 * one - 2, t)
    return np.stack((np.stack(value, -1) / 6.0, np.stack(slope, -1), np.stack(bend, -1)))


class SplineVolume:
    """A smooth scalar through values on a cubic grid; places are counted in nodes."""

    def __init__(self, values: Floats) -> None:
        self._coefficients: Floats = spline_filter(values, order=3, output=np.float64)

    def value(self, places: Floats) -> Floats:
        """Return the scalar (n,) at places (n, 3)."""
        return map_coordinates(
            self._coefficients, places.T, order=3, prefilter=False, mode="nearest"
        )

    def gradient(self, places: Floats) -> Floats:
        """Return the derivatives (n, 3) by the place, per node."""
        limit = np.array(self._coefficients.shape) - 3
        cell = np.clip(np.floor(places).astype(np.int64), 1, limit)
        weights = cubic_weights(places - cell)  # (3 orders, n, 3 axes, 4 nodes)
        reach = np.arange(-1, 3)
        i, j, k = (cell[:, axis, None] + reach for axis in range(3))
        nodes = self._coefficients[i[:, :, None, None], j[:, None, :, None], k[:, None, None, :]]
        parts = []
        for axis in range(3):
            wi, wj, wk = (weights[int(a == axis), :, a] for a in range(3))
            along_k = np.einsum("nijk,nk->nij", nodes, wk)
            parts.append(np.einsum("nij,ni,nj->n", along_k, wi, wj))
        return np.stack(parts, axis=1)
