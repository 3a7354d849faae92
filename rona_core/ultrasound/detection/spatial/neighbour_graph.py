"""Neighbour graph of a survey: for each A-scan the nearest one in each of eight directions.

Positions may be scattered. Without positions the order of the survey is a line, one scan after
another, and there are two directions instead of eight.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints

DIRECTIONS = 8
REACH_MM = 5.0  # scans further apart say little about each other
AROUND = 24  # of the nearest make a plane
MOST_NEIGHBOURS = 96  # that are looked at; the reach shrinks in denser surveys
LEAST_APART_MM = 1e-3  # scans closer than this have no direction from one to the other
ALONG_MM = 1.0  # what a step along a survey without positions counts for


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """Neighbours of each of n A-scans in each of d directions."""

    sources: Ints  # (d, n) number of the A-scan on that side, -1 for none
    apart_mm: Floats  # (d, n) how far that one is
    steps_mm: Floats  # (d, n, 2) from here to there, in the plane of the scan
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
    steps = np.zeros((2, n, 2))
    steps[0, :, 0], steps[1, :, 0] = -ALONG_MM, ALONG_MM
    offsets = np.array([-4, -3, -2, -1, 1, 2, 3, 4])[:, None]
    beside = order + offsets
    beside = np.where((beside >= 0) & (beside < n), beside, -1)
    far = np.broadcast_to(ALONG_MM * np.abs(offsets), beside.shape)
    along = np.broadcast_to(ALONG_MM * offsets, beside.shape)
    near_mm = np.stack((along, np.zeros(beside.shape)), axis=2)
    rounds = np.stack((order, order[::-1]))
    return Links(sources, apart, steps, rounds, beside, far, beside, near_mm)


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
    steps = np.zeros((DIRECTIONS, n, 2))
    sources[sector[nearest], first[nearest]] = second[nearest]
    distances[sector[nearest], first[nearest]] = apart[nearest]
    steps[sector[nearest], first[nearest]] = flat[second[nearest]] - flat[first[nearest]]
    rounds = np.stack([_rounds(row) for row in sources])
    around, around_mm = _around(flat)
    return Links(sources, distances, steps, rounds, sources, distances, around, around_mm)


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
