"""Fewest path points within an error bound: shortest path over all admissible segments.

Source: Imai and Iri, Polygonal approximations of a curve (1988). A segment is admissible if the
original piece is within the bound; in the sense of Fréchet, strokes that run back over themselves
are not lost.
"""

from itertools import pairwise

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.path.simplification.error_bound import ShortcutTest
from rona_core.path.simplification.reachable_ends import horizons, pairs_ahead, possible

OPTIMAL_RULE = "fewest points; among equals, read from the end, the latest previous point"
SAMPLES = 64
FEW_PAIRS = 6000  # so many are tried at once
GROUPS = (1, 4, 16, 64)  # the front is tried in groups that end here, the latest points first
MAX_WORK = 2.5e8  # distances that an exact search may have to look at, some 10 s


def work_estimate(columns: Floats, fixed: Bools, test: ShortcutTest) -> float:
    """Return about how many distances :func:`fewest_points` looks at."""
    n = columns.shape[1]
    starts = np.unique(np.linspace(0, n - 2, min(n - 1, SAMPLES)).astype(np.int64))
    ahead = horizons(columns, starts, next_fixed(fixed)[starts], test.near_mm) - starts
    if test.near_mm == np.inf:  # every point between every pair
        return float(np.mean(ahead**2 / 2.0)) * n
    return float(np.mean(8.0 * ahead + ahead**2 / 20.0)) * n


def next_fixed(fixed: Bools) -> Ints:
    """Return for each point but the last the next one that must stay (n - 1,)."""
    stays = np.flatnonzero(fixed)
    return stays[np.searchsorted(stays, np.arange(len(fixed) - 1), side="right")]


def fewest_points(columns: Floats, fixed: Bools, test: ShortcutTest) -> Ints:
    """Return the indices (k,) of a path with the fewest points within the error bound.

    Among paths of the same number of points, read from the end, each point follows the latest one
    that it can follow.

    Args:
        columns: The path as (m, n), n >= 1, one row per dimension.
        fixed: Mask (n,) of the points that must stay, ends included.
        test: Decides which segments may replace a piece.
    """
    stays = np.flatnonzero(fixed)
    parts = [np.zeros(1, dtype=np.int64)]
    for start, end in pairwise(stays.tolist()):
        parts.append(_section(columns, start, end, test))
    return np.concatenate(parts)


def _section(columns: Floats, start: int, end: int, test: ShortcutTest) -> Ints:
    """Return the fewest points after ``start`` up to ``end``, by a breadth-first search."""
    before = np.full(end + 1, -1)
    unseen = np.arange(start + 1, end + 1)
    front = np.array([start])  # points that as few segments reach, the latest first
    while before[end] < 0:
        reach = horizons(columns, front, np.full(len(front), end), test.near_mm)
        near = front[reach == end]
        last = near[test.holds(columns, near, np.full(len(near), end))]
        if len(last):
            before[end] = last[0]
            break
        found: list[Ints] = []
        groups = GROUPS if int((reach - front).sum()) > FEW_PAIRS else ()
        for some in np.split(np.arange(len(front)), groups):
            low = np.searchsorted(unseen, front[some], side="right")
            high = np.searchsorted(unseen, reach[some], side="right") - 1
            starts, at = pairs_ahead(front[some], low, high)
            starts, ends = possible(columns, starts, unseen[at], test.near_mm)
            good = test.holds(columns, starts, ends)
            met, first = np.unique(ends[good], return_index=True)  # from the latest start
            before[met] = starts[good][first]
            found.append(met)
            unseen = unseen[before[unseen] < 0]
        front = np.sort(np.concatenate(found))[::-1]
    index = [end]
    while index[-1] != start:
        index.append(int(before[index[-1]]))
    return np.array(index[-2::-1], dtype=np.int64)
