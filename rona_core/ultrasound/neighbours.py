"""Which A-scans stand beside which: for each of eight directions the nearest one that way.

Positions may be scattered. Without positions the order of the survey is a line, one scan after
another, and there are two directions instead of eight.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.arrays import Bools, Floats, Ints
from rona_core.errors import InvalidInputError

DIRECTIONS = 8
REACH_MM = 5.0  # scans further apart say little about each other
MOST_NEIGHBOURS = 96  # that are looked at; the reach shrinks in denser surveys
LEAST_APART_MM = 1e-3  # scans closer than this have no direction from one to the other
STEEP_US_PER_MM = 0.2  # rms rise of the inner boundary from one scan to the next, two-way
ALONG_MM = 1.0  # what a step along a survey without positions counts for


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """From whom each of n A-scans hears in each of d directions."""

    sources: Ints  # (d, n) number of the A-scan on that side, -1 for none
    apart_mm: Floats  # (d, n) how far that one is
    steps_mm: Floats  # (d, n, 2) from here to there, in the plane of the scan
    rounds: Ints  # (d, n) steps from the rim in this direction: 0 where there is no source
    beside: Ints  # (8, n) whom else to ask whether a boundary goes on, -1 for none
    beside_mm: Floats  # (8, n) how far those are


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
    return Links(sources, apart, steps, np.stack((order, order[::-1])), beside, far)


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
            f"{n} A-scans need finite positions of shape ({n}, 3), not {places.shape}"
        )
    if n < 2 or np.ptp(places, axis=0).max() < LEAST_APART_MM:
        return line_links(n)
    flat, axes = _laid_flat(places)
    here, there, apart = _pairs(flat)
    gap = flat[there] - flat[here]
    # the direction a message travels in is from there to here
    sector = np.floor(np.arctan2(-gap[:, 1], -gap[:, 0]) * DIRECTIONS / (2.0 * np.pi) + 0.5)
    sector = sector.astype(np.int64) % DIRECTIONS
    order = np.lexsort((axes[there], apart, here, sector))
    sector, here, there, apart = sector[order], here[order], there[order], apart[order]
    first = np.ones(len(here), dtype=np.bool_)
    first[1:] = (sector[1:] != sector[:-1]) | (here[1:] != here[:-1])
    sources = np.full((DIRECTIONS, n), -1, dtype=np.int64)
    distances = np.zeros((DIRECTIONS, n))
    steps = np.zeros((DIRECTIONS, n, 2))
    sources[sector[first], here[first]] = there[first]
    distances[sector[first], here[first]] = apart[first]
    steps[sector[first], here[first]] = flat[there[first]] - flat[here[first]]
    rounds = np.stack([_rounds(row) for row in sources])
    return Links(sources, distances, steps, rounds, sources, distances)


def expected_lags(
    lag_us: Floats, sigma_us: Floats, counts: Bools, links: Links
) -> tuple[Floats, Floats, Floats]:
    """Return what is expected (n,) between opposite neighbours, and its sd, infinite for nothing.

    The third is how steep the boundary is (n,), in us per mm, 0 where that is not known.

    Where the boundary slopes, one side is as much too early as the other is too late. The median
    over the directions lets a single neighbour be wrong, and the spread says how well they agree;
    where there is one pair alone, its own sigmas do. Where there is none, the nearest neighbour on
    one side is all there is, and the slope to it is not known.
    """
    alone, alone_sd = _nearest(lag_us, sigma_us, counts, links)
    half = len(links.sources) // 2
    means: list[Floats] = []
    steep, own = np.zeros(len(lag_us)), np.zeros(len(lag_us))
    for k in range(half):
        # without positions the two directions of the line are each other's opposite
        here, there = links.sources[k], links.sources[k + half]
        both = (here >= 0) & (there >= 0) & counts[here] & counts[there]
        apart = np.maximum(links.apart_mm[k] + links.apart_mm[k + half], LEAST_APART_MM)
        rise = np.where(both, (lag_us[there] - lag_us[here]) / apart, np.nan)
        means.append(lag_us[here] + links.apart_mm[k] * rise)
        steep = np.fmax(steep, np.abs(rise))
        pair_us = np.hypot(sigma_us[here], sigma_us[there]) / 2.0
        own = np.where(both, np.maximum(own, pair_us), own)
    table = np.sort(np.stack(means), axis=0)  # nan last
    count = np.isfinite(table).sum(axis=0)
    some = count > 0
    rows = np.arange(table.shape[1])
    low, high = np.maximum(count - 1, 0) // 2, count // 2
    high = np.minimum(high, np.maximum(count - 1, 0))
    middle = np.where(some, (table[low, rows] + table[high, rows]) / 2.0, alone)
    first, last = table[0], table[np.maximum(count - 1, 0), rows]
    spread = np.where(count > 1, (last - first) / 2.0, own)
    return middle, np.where(some, spread, alone_sd), steep


def _nearest(
    lag_us: Floats, sigma_us: Floats, counts: Bools, links: Links
) -> tuple[Floats, Floats]:
    """Return the lag (n,) of the nearest neighbour that counts and its sd here, or infinity."""
    there = links.sources
    apart = np.where((there >= 0) & counts[there], links.apart_mm, np.inf)
    nearest = np.argmin(apart, axis=0)
    rows = np.arange(len(lag_us))
    found, far = there[nearest, rows], apart[nearest, rows]
    some = np.isfinite(far)
    sd = np.hypot(sigma_us[found], STEEP_US_PER_MM * np.where(some, far, 0.0))
    return np.where(some, lag_us[found], lag_us), np.where(some, sd, np.inf)


def _laid_flat(places: Floats) -> tuple[Floats, Floats]:
    """Return places (n, 2) in the best plane, and the first of the two coordinates (n,)."""
    centred = places - places.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    flat = centred @ axes[:2].T
    return flat, flat[:, 0]


def _pairs(flat: Floats) -> tuple[Ints, Ints, Floats]:
    """Return ordered pairs (m,) of places within reach, and their distances."""
    tree = KDTree(flat)
    count = min(MOST_NEIGHBOURS + 1, len(flat))
    distance, index = tree.query(flat, k=count, distance_upper_bound=REACH_MM)
    here = np.repeat(np.arange(len(flat)), count)
    there, apart = index.ravel(), distance.ravel()
    kept: Bools = np.isfinite(apart) & (apart > LEAST_APART_MM)
    return here[kept], there[kept].astype(np.int64), apart[kept]


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
