"""Paths of few points within an error bound: the fewest, or nearly so in nearly linear time.

Reachable ends of the shortcuts from a path point, to narrow the search. Seen from a point, the ball
about each later one is a cone, and a segment must pass through all of them. Where the narrowest
cone so far and a new one do not meet, nothing farther can be reached. Safe, because a segment is
never nearer than its ray.

Fewest path points within an error bound: shortest path over all admissible segments. Source: Imai
and Iri, Polygonal approximations of a curve (1988). A segment is admissible if the original piece
is within the bound; in the sense of Fréchet, strokes that run back over themselves are not lost.

Beam search for a path of few points, in nearly linear time. A breadth-first search like the exact
one, of which only the farthest few points survive each step.
"""

from itertools import pairwise

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.path.simplification.error_bound import ShortcutTest

FIRST_WINDOW = 32
SLACK_RAD = 1e-9
FINEST = 64  # of a piece: the share between neighbouring probes, at the last
AT_ONCE = 100_000  # rays in one go


def horizons(
    columns: Floats, starts: Ints, last: Ints, near_mm: float, window: int = FIRST_WINDOW
) -> Ints:
    """Return for each start the last end that a segment could reach.

    Args:
        columns: The path as (m, n), one row per dimension.
        starts: Points (q,) to start from.
        last: The last end (q,) that is asked for, e.g. the next point that must stay.
        near_mm: Bound on the distance.
        window: How far to look at first; it doubles as long as needed.
    """
    reach = last.copy()
    if near_mm == np.inf:
        return reach
    todo = np.flatnonzero(last - starts > 2)
    while len(todo):
        rows = max(AT_ONCE // window, 1)
        for some in np.split(todo, np.arange(rows, len(todo), rows)):
            seen = starts[some] + _reach(columns, starts[some], window, near_mm)
            reach[some] = np.minimum(last[some], seen)
        full = (reach[todo] == starts[todo] + window) & (reach[todo] < last[todo])
        todo, window = todo[full], 2 * window
    return reach


def _reach(columns: Floats, starts: Ints, window: int, near_mm: float) -> Ints:
    """Return how many points ahead (q,) the cones still meet, at most ``window``."""
    at = np.minimum(starts[:, None] + np.arange(1, window + 1), columns.shape[1] - 1)
    rays = columns[:, at] - columns[:, starts, None]
    length = np.sqrt(_squares(rays))
    outside = length > near_mm
    rays /= np.where(length > 0, length, 1.0)
    sine = np.where(outside, near_mm / np.where(outside, length, 1.0), np.inf)
    least = np.minimum.accumulate(sine, axis=1)
    fresh = np.ones(sine.shape, dtype=np.bool_)
    fresh[:, 1:] = sine[:, 1:] < least[:, :-1]
    narrowest = np.maximum.accumulate(np.where(fresh, np.arange(window), 0), axis=1)[:, :-1]
    known = outside[:, 1:] & (least[:, :-1] < np.inf)
    row, column = np.nonzero(known)
    other = narrowest[row, column]
    chord = rays[:, row, column + 1] - rays[:, row, other]
    apart = 2.0 * np.arcsin(np.minimum(np.sqrt(_squares(chord)) / 2.0, 1.0))
    halves = np.arcsin(sine[row, column + 1]) + np.arcsin(sine[row, other])
    beyond = np.zeros(known.shape, dtype=np.bool_)
    beyond[row, column] = apart > halves + SLACK_RAD
    return np.where(beyond.any(axis=1), beyond.argmax(axis=1) + 1, window)


def _squares(columns: Floats) -> Floats:
    """Return the sums of squares of columns (m, ...), row by row: quicker than ``sum`` for few."""
    total = columns[0] ** 2
    for row in columns[1:]:
        total += row**2
    return total


def possible(columns: Floats, starts: Ints, ends: Ints, near_mm: float) -> tuple[Ints, Ints]:
    """Return the pairs whose segment passes near a few of the points between: most that will do."""
    if near_mm == np.inf:
        return starts, ends
    parts = 2
    while parts <= FINEST and len(starts):
        long = np.flatnonzero(ends - starts > 4 * parts)
        if not len(long):
            break
        shares = np.arange(1, parts, 2)[:, None] / parts
        near = np.ones(len(starts), dtype=np.bool_)
        for some in np.split(long, np.arange(0, len(long), AT_ONCE // parts)[1:]):
            away_sq = _away_sq(columns, starts[some], ends[some], shares)
            near[some] = (away_sq <= near_mm**2 * (1.0 + 1e-9)).all(axis=0)
        starts, ends = starts[near], ends[near]
        parts *= 2
    return starts, ends


def _away_sq(columns: Floats, starts: Ints, ends: Ints, shares: Floats) -> Floats:
    """Return squared distances (s, q) of points at ``shares`` (s, 1) of pieces from segments."""
    probe = starts + np.rint(shares * (ends - starts)).astype(np.int64)
    origin = columns[:, starts]
    chord = columns[:, ends] - origin
    length_sq = _squares(chord)
    rays = [column[probe] - first for column, first in zip(columns, origin, strict=True)]
    t = np.zeros(probe.shape)
    for ray, side in zip(rays, chord, strict=True):
        t += ray * side
    t = np.clip(t / np.where(length_sq > 0, length_sq, 1.0), 0.0, 1.0)
    total = np.zeros(probe.shape)
    for ray, side in zip(rays, chord, strict=True):
        total += (ray - t * side) ** 2
    return total


def pairs_ahead(starts: Ints, first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """Return all pairs of a start and an end from its ``first`` to its ``last``, both included."""
    counts = np.maximum(last - first + 1, 0)
    offset = np.cumsum(counts) - counts
    ends = np.arange(int(counts.sum())) + np.repeat(first - offset, counts)
    return np.repeat(starts, counts), ends


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
