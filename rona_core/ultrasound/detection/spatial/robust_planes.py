"""Robust planes through what the neighbours of each place of a survey say."""

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats

REACH_MM = 5.0
MOST, LEAST = 96, 6  # neighbours
REWEIGHTS = 6
MAD_TO_SD = 1.4826
FLOOR = 0.02  # us or mm; no scatter is taken for less
STRANGE = 1.5  # scatters off, from where on a neighbour counts less than half
SYMMETRIC = np.array(((0, 1, 2), (1, 3, 4), (2, 4, 5)))  # places of a matrix in its upper half
RIDGE = 1e-6  # keeps neighbours on one line solvable


class LocalPlanes:
    """The neighbours of each place (n, 2 or more), and robust planes through what they say."""

    def __init__(self, places: Floats) -> None:
        n, flat = len(places), places[:, :2]
        most = min(MOST + 1, n)
        away, near = KDTree(flat).query(flat, k=most, distance_upper_bound=REACH_MM)
        near = np.asarray(near, dtype=np.int64)
        counts = np.isfinite(away) & (near != np.arange(n)[:, None])
        most = int(counts.sum(axis=1).max(initial=0)) + 1  # the nearest come first
        near, self._counts = near[:, :most], counts[:, :most]
        self._near = np.where(self._counts, near, 0)
        self.known: Bools = np.asarray(self._counts.sum(axis=1) >= LEAST)
        step = np.where(self._counts[..., None], flat[self._near] - flat[:, None], 0.0)
        self._design = np.concatenate((np.ones((*near.shape, 1)), step), axis=2)
        i, j = np.triu_indices(3)
        self._products = self._design[..., i] * self._design[..., j]
        some = np.maximum(self._counts.sum(axis=1), 1)
        self._middle = np.stack((some // 2, (some - 1) // 2), axis=1)

    def planes(self, values: Floats, sds: Floats) -> tuple[Floats, Floats, Floats]:
        """Return what a plane says of each place (n,), its rise (n, 2) and the scatter about it."""
        # against one's own value, so that the ridge pulls to nothing else
        target = values[self._near] - values[:, None]
        trust = np.where(self._counts, 1.0 / (FLOOR**2 + sds[self._near] ** 2), 0.0)
        ridge = RIDGE * trust.sum(axis=1)[:, None, None] * np.eye(3) + 1e-9 * np.eye(3)
        weights, plane, scatter = trust, np.zeros((len(values), 3)), np.zeros(len(values))
        for _ in range(REWEIGHTS):
            normal = (weights[:, None, :] @ self._products)[:, 0, SYMMETRIC] + ridge
            right = (weights * target)[:, None, :] @ self._design
            plane = np.linalg.solve(normal, right[:, 0, :, None])[..., 0]
            left = np.abs(target - (self._design @ plane[..., None])[..., 0])
            scatter = np.maximum(MAD_TO_SD * self._medians(left), FLOOR)
            weights = trust / (1.0 + (left / (STRANGE * scatter)[:, None]) ** 2)
        return values + plane[:, 0], plane[:, 1:], scatter

    def _medians(self, values: Floats) -> Floats:
        """Return the median (n,) of what the neighbours say (n, k), 0 where there is none."""
        ranked = np.sort(np.where(self._counts, values, np.inf), axis=1)
        two = np.take_along_axis(ranked, self._middle, axis=1)
        return np.where(self._counts.any(axis=1), two.mean(axis=1), 0.0)
