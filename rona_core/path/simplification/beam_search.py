"""Beam search for a path of few points, in nearly linear time.

A breadth-first search like the exact one, of which only the farthest few points survive each step.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.path.simplification.error_bound import ShortcutTest
from rona_core.path.simplification.reachable_ends import (
    FIRST_WINDOW,
    horizons,
    pairs_ahead,
    possible,
)
from rona_core.path.simplification.shortest_path import next_fixed

BEAM = 4
FAST_RULE = f"few points, not surely the fewest; the farthest {BEAM} of each step are followed"
MAX_PAIRS = 6000  # segments looked at in one step; beyond it, ends are left out evenly


def beam_search(
    columns: Floats,
    fixed: Bools,
    test: ShortcutTest,
) -> Ints:
    """Return the indices (k,) of a path of few points within the error bound.

    Args:
        columns: The path as (m, n), n >= 1, one row per dimension.
        fixed: Mask (n,) of the points that must stay, ends included.
        test: Decides which segments may replace a piece.
    """
    n = columns.shape[1]
    before = np.full(n, -1)
    if n == 1:
        return np.zeros(1, dtype=np.int64)
    last = next_fixed(fixed)
    front, window = np.zeros(1, dtype=np.int64), FIRST_WINDOW
    while front[0] < n - 1:
        reached = _step(columns, front, last[front], test, window, before)
        window = max(FIRST_WINDOW, 8 * (int(reached[0]) - int(front[0])))
        stop = reached[fixed[reached]]  # nothing may pass a point that must stay
        front = stop[:1] if len(stop) else reached
    index = [n - 1]
    while index[-1] > 0:
        index.append(int(before[index[-1]]))
    return np.array(index[::-1], dtype=np.int64)


def _step(
    columns: Floats,
    front: Ints,
    last: Ints,
    test: ShortcutTest,
    window: int,
    before: Ints,
) -> Ints:
    """Return the farthest points (at most ``BEAM``) one segment ahead, the farthest first."""
    reach = horizons(columns, front, last, test.near_mm, window)
    near = front[reach == last]
    near = near[test.holds(columns, near, np.full(len(near), last[0]))]
    if len(near):
        before[last[0]] = near[0]
        return last[:1]
    farthest = int(front.max())
    starts, ends = pairs_ahead(front, np.full(len(front), farthest + 1), reach)
    if len(starts) > MAX_PAIRS:
        some = (ends - farthest - 1) % (len(starts) // MAX_PAIRS + 1) == 0
        starts, ends = starts[some], ends[some]
    starts, ends = possible(columns, starts, ends, test.near_mm)
    order = np.argsort(-ends, kind="stable")
    starts, ends = starts[order], ends[order]
    found: list[Ints] = []
    count, start, batch = 0, 0, 2 * BEAM
    while start < len(starts) and count < BEAM:
        some = slice(start, start + batch)
        good = test.holds(columns, starts[some], ends[some])
        met, which = np.unique(ends[some][good][::-1], return_index=True)
        fresh = before[met] < 0
        met, which = met[fresh], which[fresh]
        before[met] = starts[some][good][::-1][which]
        found.append(met[::-1])
        count, start, batch = count + len(met), start + batch, 2 * batch
    if not count:  # a step to the next point always holds
        before[farthest + 1] = farthest
        return np.array([farthest + 1])
    return np.concatenate(found)[:BEAM]
