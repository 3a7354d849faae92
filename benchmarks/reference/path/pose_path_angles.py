"""How far the orientations of originals are from those along the segment that replaces them.

Orientations are unit vectors: axes (3 numbers), or quaternions (4), of which q and -q are the same.
Along a segment they follow the great circle (slerp), evenly in the place on the segment.
"""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.path.simplification.error_bound import inner_rows

OPPOSITE_RAD = np.pi - 1e-6  # the great circle between is a guess from here on


def piece_turns(columns: Floats, units: Floats, starts: Ints, ends: Ints) -> Floats:
    """Return for each piece (q,) the largest angle in rad at the feet of its originals.

    Each original is compared with the orientation at its own foot on the segment. Where the
    segment has no length, the count of originals stands for the place on it.

    Args:
        columns: Positions as (m, n), one row per dimension.
        units: Orientations as (3, n) axes or (4, n) quaternions.
        starts: Index (q,) of the first original of each piece.
        ends: Index (q,) of its last; nothing between gives 0.
    """
    turns = np.zeros(len(starts))
    busy = np.flatnonzero(ends - starts > 1)
    if not len(busy):
        return turns
    starts, ends = starts[busy], ends[busy]
    rows, counts, first = inner_rows(starts, ends)
    origin, chord = columns[:, starts], columns[:, ends] - columns[:, starts]
    length_sq = (chord**2).sum(axis=0)
    rays = columns[:, rows] - np.repeat(origin, counts, axis=1)
    share = (rays * np.repeat(chord, counts, axis=1)).sum(axis=0)
    share /= np.repeat(np.where(length_sq > 0, length_sq, 1.0), counts)
    counted = (rows - np.repeat(starts, counts)) / np.repeat(ends - starts, counts)
    share = np.where(np.repeat(length_sq > 0, counts), np.clip(share, 0.0, 1.0), counted)
    a, b = units[:, starts], units[:, ends]
    double = len(units) == 4
    if double:
        b = np.where((a * b).sum(axis=0) < 0.0, -b, b)
    angle = between(a, b)
    unknown = angle > OPPOSITE_RAD
    b, angle = np.where(unknown, a, b), np.where(unknown, 0.0, angle)
    along = great_circle(
        np.repeat(a, counts, axis=1), np.repeat(b, counts, axis=1), np.repeat(angle, counts), share
    )
    off = between(along, units[:, rows])
    if double:
        off = 2.0 * np.minimum(off, np.pi - off)
    turns[busy] = np.where(unknown, np.inf, np.maximum.reduceat(off, first))
    return turns


def between(a: Floats, b: Floats) -> Floats:
    """Return the angle (k,) between unit vectors (d, k), accurate also for small and flat ones."""
    apart = np.sqrt(((a - b) ** 2).sum(axis=0))
    return 2.0 * np.arctan2(apart, np.sqrt(((a + b) ** 2).sum(axis=0)))


def great_circle(a: Floats, b: Floats, angle: Floats, share: Floats) -> Floats:
    """Return the unit vectors (d, k) at ``share`` (k,) of the way from ``a`` to ``b``."""
    tiny = angle < 1e-8
    sine = np.where(tiny, 1.0, np.sin(angle))
    first = np.where(tiny, 1.0 - share, np.sin((1.0 - share) * angle) / sine)
    second = np.where(tiny, share, np.sin(share * angle) / sine)
    mixed = first * a + second * b
    return mixed / np.sqrt((mixed**2).sum(axis=0))
