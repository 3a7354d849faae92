"""Cubic B-splines on a regular grid: weights of the four nodes around a place."""

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from rona_core.geometry.arrays import Floats


def cubic_weights(t: Floats) -> Floats:
    """Return weights of four nodes and their first and second derivatives, (3, *t, 4).

    Args:
        t: Place between the second and the third node, 0 to 1, any shape.
    """
    one = 1.0 - t
    t2, one2 = t * t, one * one
    t3, one3 = t * t2, one * one2
    value = (one3, 3 * t3 - 6 * t2 + 4, 3 * one3 - 6 * one2 + 4, t3)
    slope = (-one2 / 2, 1.5 * t2 - 2 * t, -1.5 * one2 + 2 * one, t2 / 2)
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
        weights, nodes = self._around(places)
        parts = [_contract(weights, nodes, tuple(np.eye(3, dtype=int)[axis])) for axis in range(3)]
        return np.stack(parts, axis=1)

    def hessian(self, places: Floats) -> Floats:
        """Return the second derivatives (n, 3, 3) by the place, per node squared."""
        weights, nodes = self._around(places)
        unit = np.eye(3, dtype=int)
        result = np.zeros((len(places), 3, 3))
        for a in range(3):
            for b in range(a, 3):
                result[:, a, b] = _contract(weights, nodes, tuple(unit[a] + unit[b]))
                result[:, b, a] = result[:, a, b]
        return result

    def _around(self, places: Floats) -> tuple[Floats, Floats]:
        """Return weights (3 orders, n, 3 axes, 4) and coefficients (n, 4, 4, 4) about places."""
        limit = np.array(self._coefficients.shape) - 3
        cell = np.clip(np.floor(places).astype(np.int64), 1, limit)
        reach = np.arange(-1, 3)
        i, j, k = (cell[:, axis, None] + reach for axis in range(3))
        nodes = self._coefficients[i[:, :, None, None], j[:, None, :, None], k[:, None, None, :]]
        return cubic_weights(places - cell), nodes


def _contract(weights: Floats, nodes: Floats, orders: tuple[int, ...]) -> Floats:
    """Return the derivative (n,) of the given order along each axis."""
    wi, wj, wk = (weights[order, :, axis] for axis, order in enumerate(orders))
    along_k = np.einsum("nijk,nk->nij", nodes, wk)
    return np.einsum("nij,ni,nj->n", along_k, wi, wj)
