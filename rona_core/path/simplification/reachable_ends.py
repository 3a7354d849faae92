"""Reachable ends of the shortcuts from a path point, to narrow the search.

Seen from a point, the ball about each later one is a cone, and a segment must pass through all of
them. Where the narrowest cone so far and a new one do not meet, nothing farther can be reached.
Safe, because a segment is never nearer than its ray.
"""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints

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
