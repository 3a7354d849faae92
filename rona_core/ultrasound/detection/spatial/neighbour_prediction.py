"""Prediction of an inner boundary from its neighbours: the plane that fits them best.

The envelope of an echo that is hardly louder than the noise says to a cycle or two when it comes,
its phase says it to a fraction of one. Two dozen envelopes on one plane say which cycle.
"""

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.robust import MAD_TO_SIGMA
from rona_core.ultrasound.detection.spatial.neighbour_graph import Links

BENT_US_PER_MM = 0.02  # how far, for each mm of distance, a boundary leaves its plane
STEEP_US_PER_MM = 0.3  # rms slope to be expected
ROBUST_ROUNDS = 3
OUTLYING = 2.0  # sigmas from the plane, where a neighbour counts half
FEW = 3  # neighbours that show a slope
PLANE_REACH_MM = 5.0
MOST_NEIGHBOURS, LEAST_NEIGHBOURS = 96, 6
PLANE_ROUNDS = 6
SCATTER_FLOOR = 0.02  # us or mm; no scatter is taken for less
OUTLYING_SCATTERS = 1.5  # scatters off, from where on a neighbour counts less than half
SYMMETRIC = np.array(((0, 1, 2), (1, 3, 4), (2, 4, 5)))  # places of a matrix in its upper half
RIDGE = 1e-6  # keeps neighbours on one line solvable


def predict_lags(
    lag_us: Floats, sigma_us: Floats, counts: Bools, links: Links
) -> tuple[Floats, Floats, Floats]:
    """Return the lag (n,) that the plane through the neighbours has here, its sd, and its slope.

    Args:
        lag_us: Of each A-scan (n,).
        sigma_us: And how far off it may be.
        counts: Which ones are asked (n,).
        links: Who is around whom.

    The sd is infinite where no neighbour counts. Where fewer than three do, no more is known of the
    slope than how steep bone usually is; in us per mm, it is 0 there.
    """
    index = links.around
    asked = (index >= 0) & counts[index]
    distance = np.hypot(links.around_mm[..., 0], links.around_mm[..., 1])
    variance = sigma_us[index] ** 2 + (BENT_US_PER_MM * distance) ** 2
    precision = np.where(asked, 1.0 / np.maximum(variance, 1e-12), 0.0)
    design = np.concatenate((np.ones((*index.shape, 1)), links.around_mm), axis=2)
    observed = np.where(asked, lag_us[index], 0.0)
    start = _weighted_median(observed, precision)
    ridge = np.diag((0.0, STEEP_US_PER_MM**-2, STEEP_US_PER_MM**-2)) + 1e-9 * np.eye(3)
    plane = np.column_stack((start, np.zeros((len(lag_us), 2))))
    inverse = np.zeros((len(lag_us), 3, 3))
    for _ in range(ROBUST_ROUNDS):
        off = (observed - np.einsum("knj,nj->kn", design, plane)) ** 2 * precision
        weight = precision / (1.0 + off / OUTLYING**2)
        normal = np.einsum("kn,kni,knj->nij", weight, design, design) + ridge
        right = np.einsum("kn,kn,kni->ni", weight, observed - start, design)
        inverse = np.linalg.inv(normal)
        plane = np.einsum("nij,nj->ni", inverse, right)
        plane[:, 0] += start
    some, enough = asked.any(axis=0), asked.sum(axis=0) >= FEW
    off = np.where(asked, (observed - np.einsum("knj,nj->kn", design, plane)) ** 2 * precision, 0.0)
    excess = (off / (1.0 + off / OUTLYING**2)).sum(axis=0) / np.maximum(asked.sum(axis=0), 1)
    sd = np.sqrt(inverse[:, 0, 0] * np.maximum(excess, 1.0))
    return (
        np.where(some, plane[:, 0], lag_us),
        np.where(some, sd, np.inf),
        np.where(enough, np.hypot(plane[:, 1], plane[:, 2]), 0.0),
    )


def _weighted_median(values: Floats, weights: Floats) -> Floats:
    """Return the weighted medians (n,) of the columns of (k, n)."""
    order = np.argsort(values, axis=0)
    share = np.cumsum(np.take_along_axis(weights, order, axis=0), axis=0)
    at = np.argmax(share >= 0.5 * share[-1:], axis=0)
    rows = np.arange(values.shape[1])
    return values[order[at, rows], rows]


class LocalPlanes:
    """Robust planes through the values of the neighbours of each place (n, 2 or more)."""

    def __init__(self, places: Floats) -> None:
        n, flat = len(places), places[:, :2]
        most = min(MOST_NEIGHBOURS + 1, n)
        away, near = KDTree(flat).query(flat, k=most, distance_upper_bound=PLANE_REACH_MM)
        near = np.asarray(near, dtype=np.int64)
        counts = np.isfinite(away) & (near != np.arange(n)[:, None])
        most = int(counts.sum(axis=1).max(initial=0)) + 1  # the nearest come first
        near, self._counts = near[:, :most], counts[:, :most]
        self._near = np.where(self._counts, near, 0)
        self.known: Bools = np.asarray(self._counts.sum(axis=1) >= LEAST_NEIGHBOURS)
        step = np.where(self._counts[..., None], flat[self._near] - flat[:, None], 0.0)
        self._design = np.concatenate((np.ones((*near.shape, 1)), step), axis=2)
        i, j = np.triu_indices(3)
        self._products = self._design[..., i] * self._design[..., j]
        some = np.maximum(self._counts.sum(axis=1), 1)
        self._middle = np.stack((some // 2, (some - 1) // 2), axis=1)

    def planes(self, values: Floats, sds: Floats) -> tuple[Floats, Floats, Floats]:
        """Return what the planes predict at each place (n,), slopes (n, 2), and scatters (n,)."""
        # relative to the value at the place, so that the ridge pulls to nothing else
        target = values[self._near] - values[:, None]
        trust = np.where(self._counts, 1.0 / (SCATTER_FLOOR**2 + sds[self._near] ** 2), 0.0)
        ridge = RIDGE * trust.sum(axis=1)[:, None, None] * np.eye(3) + 1e-9 * np.eye(3)
        weights, plane, scatter = trust, np.zeros((len(values), 3)), np.zeros(len(values))
        for _ in range(PLANE_ROUNDS):
            normal = (weights[:, None, :] @ self._products)[:, 0, SYMMETRIC] + ridge
            right = (weights * target)[:, None, :] @ self._design
            plane = np.linalg.solve(normal, right[:, 0, :, None])[..., 0]
            residual = np.abs(target - (self._design @ plane[..., None])[..., 0])
            scatter = np.maximum(MAD_TO_SIGMA * self._medians(residual), SCATTER_FLOOR)
            weights = trust / (1.0 + (residual / (OUTLYING_SCATTERS * scatter)[:, None]) ** 2)
        return values + plane[:, 0], plane[:, 1:], scatter

    def _medians(self, values: Floats) -> Floats:
        """Return the median (n,) over the neighbours (n, k), 0 where there is none."""
        ranked = np.sort(np.where(self._counts, values, np.inf), axis=1)
        two = np.take_along_axis(ranked, self._middle, axis=1)
        return np.where(self._counts.any(axis=1), two.mean(axis=1), 0.0)
