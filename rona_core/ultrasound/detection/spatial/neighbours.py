"""Neighbour graph of a survey: for each A-scan the nearest one in each of eight directions.

Positions may be scattered. Without positions the order of the survey is a line, one scan after
another, and there are two directions instead of eight.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.robust import MAD_TO_SIGMA

DIRECTIONS = 8
REACH_MM = 5.0  # scans further apart say little about each other
AROUND = 24  # of the nearest make a plane
MOST_NEIGHBOURS = 96  # that are looked at; the reach shrinks in denser surveys
LEAST_APART_MM = 1e-3  # scans closer than this have no direction from one to the other
ALONG_MM = 1.0  # what a step along a survey without positions counts for
BENT_US_PER_MM = 0.02  # how far, for each mm of distance, a boundary leaves its plane
STEEP_US_PER_MM = 0.3  # rms slope to be expected
ROBUST_ROUNDS = 3
OUTLYING = 2.0  # sigmas from the plane, where a neighbour counts half
FEW = 3  # neighbours that show a slope
PLANE_REACH_MM = 5.0
LEAST_NEIGHBOURS = 6
PLANE_ROUNDS = 6
SCATTER_FLOOR = 0.02  # us or mm; no scatter is taken for less
OUTLYING_SCATTERS = 1.5  # scatters off, from where on a neighbour counts less than half
SYMMETRIC = np.array(((0, 1, 2), (1, 3, 4), (2, 4, 5)))  # places of a matrix in its upper half
RIDGE = 1e-6  # keeps neighbours on one line solvable


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """Neighbours of each of n A-scans in each of d directions."""

    sources: Ints  # (d, n) number of the A-scan on that side, -1 for none
    apart_mm: Floats  # (d, n) how far that one is
    rounds: Ints  # (d, n) steps from the rim in this direction: 0 where there is no source
    beside: Ints  # (8, n) whom else to ask whether a boundary goes on, -1 for none
    beside_mm: Floats  # (8, n) how far those are
    around: Ints  # (k, n) the nearest ones, -1 for none
    around_mm: Floats  # (k, n, 2) from here to those, in the plane of the scan


def line_links(n: int) -> Links:
    """Return the links of a survey of n A-scans of which only the order is known."""
    order = np.arange(n, dtype=np.int64)
    sources = np.stack((order - 1, np.where(order + 1 < n, order + 1, -1)))
    apart = np.full((2, n), ALONG_MM)
    offsets = np.array([-4, -3, -2, -1, 1, 2, 3, 4])[:, None]
    beside = order + offsets
    beside = np.where((beside >= 0) & (beside < n), beside, -1)
    far = np.broadcast_to(ALONG_MM * np.abs(offsets), beside.shape)
    along = np.broadcast_to(ALONG_MM * offsets, beside.shape)
    near_mm = np.stack((along, np.zeros(beside.shape)), axis=2)
    rounds = np.stack((order, order[::-1]))
    return Links(sources, apart, rounds, beside, far, beside, near_mm)


def scan_links(positions_mm: Floats | None, n: int) -> Links:
    """Return the links of n A-scans at positions (n, 3), or on a line where these are None.

    The places are laid flat into the plane that fits them best; a sector of 45 degrees about each
    direction is searched. The result does not depend on the order of the A-scans.

    Raises:
        InvalidInputError: positions of another shape, or not finite.
    """
    if positions_mm is None:
        return line_links(n)
    places = np.asarray(positions_mm, dtype=np.float64)
    if places.shape != (n, 3) or not np.isfinite(places).all():
        raise InvalidInputError(
            f"{n} A-scans need positions of shape ({n}, 3), all finite: "
            f"got {places.shape}, {int(np.isfinite(places).sum())} numbers finite"
        )
    if n < 2 or np.ptp(places, axis=0).max() < LEAST_APART_MM:
        return line_links(n)
    flat = _laid_flat(places)
    first, second, apart = _pairs(flat)
    gap = flat[second] - flat[first]
    # a message travels from the second of a pair to the first
    sector = np.floor(np.arctan2(-gap[:, 1], -gap[:, 0]) * DIRECTIONS / (2.0 * np.pi) + 0.5)
    sector = sector.astype(np.int64) % DIRECTIONS
    order = np.lexsort((flat[second, 0], apart, first, sector))
    sector, first, second, apart = sector[order], first[order], second[order], apart[order]
    nearest = np.ones(len(first), dtype=np.bool_)
    nearest[1:] = (sector[1:] != sector[:-1]) | (first[1:] != first[:-1])
    sources = np.full((DIRECTIONS, n), -1, dtype=np.int64)
    distances = np.zeros((DIRECTIONS, n))
    sources[sector[nearest], first[nearest]] = second[nearest]
    distances[sector[nearest], first[nearest]] = apart[nearest]
    rounds = np.stack([_rounds(row) for row in sources])
    around, around_mm = _around(flat)
    return Links(sources, distances, rounds, sources, distances, around, around_mm)


def plane_axes(places: Floats) -> Floats:
    """Return axes as columns (3, 3): two in the plane that fits places best, and its normal."""
    centred = places - places.mean(axis=0)
    return np.linalg.svd(centred, full_matrices=False)[2].T


def _laid_flat(places: Floats) -> Floats:
    """Return places (n, 2) in the plane that fits them best."""
    return np.asarray((places - places.mean(axis=0)) @ plane_axes(places)[:, :2])


def _around(flat: Floats) -> tuple[Ints, Floats]:
    """Return the nearest places (k, n) within reach, -1 for none, and the way there (k, n, 2)."""
    count = min(AROUND + 1, len(flat))
    distance, index = KDTree(flat).query(flat, k=count, distance_upper_bound=REACH_MM)
    itself = index == np.arange(len(flat))[:, None]
    near = np.where(np.isfinite(distance) & ~itself, index, -1).astype(np.int64).T
    way: Floats = np.where(near[..., None] >= 0, flat[near] - flat, 0.0)
    return near, way


def _pairs(flat: Floats) -> tuple[Ints, Ints, Floats]:
    """Return ordered pairs (m,) of places within reach, and their distances."""
    tree = KDTree(flat)
    count = min(MOST_NEIGHBOURS + 1, len(flat))
    distance, index = tree.query(flat, k=count, distance_upper_bound=REACH_MM)
    first = np.repeat(np.arange(len(flat)), count)
    second, apart = index.ravel(), distance.ravel()
    kept: Bools = np.isfinite(apart) & (apart > LEAST_APART_MM)
    return first[kept], second[kept].astype(np.int64), apart[kept]


def _rounds(sources: Ints) -> Ints:
    """Return after how many steps (n,) a walk along the sources ends.

    It ends, since every step goes on in the same direction. Pointers double in each round.
    """
    n = len(sources)
    after = np.append(np.where(sources < 0, n, sources), n)  # n: beyond the rim
    steps = np.append((sources >= 0).astype(np.int64), 0)
    while (after < n).any():
        steps = steps + steps[after]
        after = after[after]
    return steps[:n]


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
    index, way = links.around.T, links.around_mm.transpose(1, 0, 2)
    asked = (index >= 0) & counts[index]
    distance = np.hypot(way[..., 0], way[..., 1])
    variance = sigma_us[index] ** 2 + (BENT_US_PER_MM * distance) ** 2
    precision = np.where(asked, 1.0 / np.maximum(variance, 1e-12), 0.0)
    design = np.concatenate((np.ones((*index.shape, 1)), way), axis=2)
    i, j = np.triu_indices(3)
    products = design[..., i] * design[..., j]
    observed = np.where(asked, lag_us[index], 0.0)
    start = _weighted_median(observed, precision)
    ridge = np.diag((0.0, STEEP_US_PER_MM**-2, STEEP_US_PER_MM**-2)) + 1e-9 * np.eye(3)
    plane = np.column_stack((start, np.zeros((len(lag_us), 2))))
    inverse = np.zeros((len(lag_us), 3, 3))
    for _ in range(ROBUST_ROUNDS):
        off = (observed - (design @ plane[..., None])[..., 0]) ** 2 * precision
        weight = precision / (1.0 + off / OUTLYING**2)
        normal = (weight[:, None, :] @ products)[:, 0, SYMMETRIC] + ridge
        right = (weight * (observed - start[:, None]))[:, None, :] @ design
        inverse = np.linalg.inv(normal)
        plane = (inverse @ right.transpose(0, 2, 1))[..., 0]
        plane[:, 0] += start
    some, enough = asked.any(axis=1), asked.sum(axis=1) >= FEW
    off = np.where(asked, (observed - (design @ plane[..., None])[..., 0]) ** 2 * precision, 0.0)
    excess = (off / (1.0 + off / OUTLYING**2)).sum(axis=1) / np.maximum(asked.sum(axis=1), 1)
    sd = np.sqrt(inverse[:, 0, 0] * np.maximum(excess, 1.0))
    return (
        np.where(some, plane[:, 0], lag_us),
        np.where(some, sd, np.inf),
        np.where(enough, np.hypot(plane[:, 1], plane[:, 2]), 0.0),
    )


def _weighted_median(values: Floats, weights: Floats) -> Floats:
    """Return the weighted medians (n,) of the rows of (n, k)."""
    order = np.argsort(values, axis=1)
    share = np.cumsum(np.take_along_axis(weights, order, axis=1), axis=1)
    at = np.argmax(share >= 0.5 * share[:, -1:], axis=1)
    rows = np.arange(len(values))
    return values[rows, order[rows, at]]


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
