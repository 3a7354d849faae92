"""Lower bound on the number of points of any path within an error bound, in nearly linear time.

If a segment within the Fréchet bound replaces the originals a to b, then any piece between a and b
is within twice the bound of its own segment. So where a piece that starts at i is not, the next
kept point after i comes before its end: every such stretch holds one.

Source: Agarwal, Har-Peled, Mustafa and Wang, Near-linear time approximation algorithms for curve
simplification (2005).
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.path.simplification.error_bound import ShortcutTest, pieces_within
from rona_core.path.simplification.shortest_path import next_fixed

CHAIN, SAMPLES = 12, 15  # stretches in a chain; all chains advance together


def points_lower_bound(columns: Floats, fixed: Bools, test: ShortcutTest) -> int:
    """Return a number of points that no path within the error bound can undercut.

    Without a Fréchet bound this is the number of points that must stay.

    Args:
        columns: The path as (m, n), one row per dimension.
        fixed: Mask (n,) of the points that must stay, ends included.
        test: Decides which segments may replace a piece.
    """
    n = columns.shape[1]
    if n < 3 or not test.bounds_frechet:
        return int(fixed.sum())
    last = next_fixed(fixed)
    stays = np.flatnonzero(fixed)
    some = np.unique(np.linspace(0, n - 2, min(SAMPLES, n - 1)).astype(np.int64))
    typical = int(np.median(_reach(columns, some, last[some], 2.0 * test.near_mm) - some))
    at = np.unique(np.concatenate((stays[:-1], np.arange(0, n - 1, CHAIN * typical))))
    stop = np.append(at[1:], n - 1)
    count = 1  # the first point
    while len(at):
        ends = _reach(columns, at, last[at], 2.0 * test.near_mm)
        whole = ends <= stop  # a stretch that runs into the next chain might be counted twice
        count += int(whole.sum())
        at, stop = ends[whole & (ends < stop)], stop[whole & (ends < stop)]
    return max(count, int(fixed.sum()))


def _reach(columns: Floats, starts: Ints, last: Ints, twice_mm: float) -> Ints:
    """Return for each start an end before which, or at which, a kept point must come."""
    reach = last.copy()
    good, bad = starts + 1, last + 1  # known to be within; known not to be, or beyond the last
    todo, step = np.flatnonzero(good < last), 2
    while len(todo):  # double the step until a piece is not within
        end = np.minimum(starts[todo] + step, last[todo])
        within = pieces_within(columns, starts[todo], end, twice_mm)
        good[todo[within]] = end[within]
        bad[todo[~within]] = end[~within]
        todo = todo[within & (end < last[todo])]
        step *= 2
    todo = np.flatnonzero(bad - good > 1)
    while len(todo):  # then close in on the border
        trial = good[todo] + np.maximum((bad[todo] - good[todo]) // 2, 1)
        within = pieces_within(columns, starts[todo], trial, twice_mm)
        good[todo[within]], bad[todo[~within]] = trial[within], trial[~within]
        todo = todo[bad[todo] - good[todo] > 1]
    found = bad <= last
    reach[found] = bad[found] - 1
    return reach
