"""The fewest path points within a bound: a shortest path over all admissible segments.

Source: Imai and Iri, Polygonal approximations of a curve (1988). A segment is admissible if the
original piece stays within the bound of it in the sense of Fréchet, so strokes that run back over
themselves are not lost.
"""

from collections.abc import Callable

import numpy as np

from rona_core.arrays import Bools, Floats, Ints
from rona_core.devices.protocols import never
from rona_core.errors import CancelledError

START_WINDOW = 16
START_BATCH, MAX_BATCH = 4, 256


def fewest_points(
    points: Floats, tolerance: float, fixed: Bools, *, cancel: Callable[[], bool] = never
) -> Ints:
    """Return the indices (k,) of a path with the fewest points within ``tolerance``.

    Among paths of the same number of points the one with the farthest next point is taken.

    Args:
        points: Path (n, m), n >= 1.
        tolerance: Fréchet bound in mm between each piece and its segment; K1 is never larger.
        fixed: Mask (n,) of the points that must stay, ends included.
        cancel: Asked now and then; True gives up.

    Raises:
        CancelledError: ``cancel`` said so.
    """
    n = len(points)
    if n == 1:
        return np.zeros(1, dtype=np.int64)
    steps = np.zeros(n, dtype=np.int64)  # fewest segments from here to the end
    following = np.zeros(n, dtype=np.int64)
    next_fixed = np.flatnonzero(fixed)
    for i in range(n - 2, -1, -1):
        if i % 64 == 0 and cancel():
            raise CancelledError("the search for the fewest points was cancelled")
        last = int(next_fixed[np.searchsorted(next_fixed, i, side="right")])
        ahead = points[i : last + 1]
        ahead = ahead[: _reach(ahead, tolerance) + 1]
        ends = np.arange(len(ahead) - 1, 0, -1)
        ends = ends[np.argsort(steps[i + ends], kind="stable")]  # best first, farthest among equals
        best = i + _first_admissible(ahead, ends, tolerance)
        steps[i], following[i] = steps[best] + 1, best
    index = [0]
    while index[-1] < n - 1:
        index.append(int(following[index[-1]]))
    return np.array(index, dtype=np.int64)


def _reach(p: Floats, tolerance: float) -> int:
    """Return the last j that a segment from p[0] could reach, looking ahead as far as needed."""
    window = START_WINDOW
    while True:
        reach = min(window, len(p) - 1)
        end = _horizon(p[: reach + 1], tolerance)
        if end < reach or reach == len(p) - 1:
            return end
        window *= 2


def _first_admissible(p: Floats, ends: Ints, tolerance: float) -> int:
    """Return the first of ``ends`` to which the segment from p[0] is admissible; 1 always is."""
    tried, batch = 0, START_BATCH
    while tried < len(ends):
        some = ends[tried : tried + batch]
        good = _frechet(p, some, tolerance)
        if good.any():
            return int(some[good.argmax()])
        tried, batch = tried + batch, min(2 * batch, MAX_BATCH)
    return 1


def _horizon(p: Floats, tolerance: float) -> int:
    """Return the last j that a segment from p[0] could reach within ``tolerance`` of all between.

    Seen from p[0], the ball about each point is a cone; a segment must pass through all of them.
    The narrowest cone so far and a new one that do not meet end the search, which is safe because
    a segment is never nearer than its ray.
    """
    rays = p[1:] - p[0]
    lengths = np.sqrt((rays**2).sum(axis=1))
    outside = np.flatnonzero(lengths > tolerance)
    if len(outside) < 2:
        return len(p) - 1
    units = rays[outside] / lengths[outside, None]
    halves = np.arcsin(tolerance / lengths[outside])
    narrowest = _running_argmin(halves)
    chord = np.sqrt(((units[1:] - units[narrowest[:-1]]) ** 2).sum(axis=1))
    apart = 2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))
    disjoint = np.flatnonzero(apart > halves[1:] + halves[narrowest[:-1]] + 1e-9)
    return int(outside[disjoint[0] + 1]) + 1 if len(disjoint) else len(p) - 1


def _running_argmin(values: Floats) -> Ints:
    """Return for each place the index of the smallest value up to there, the first of equals."""
    lowest = np.minimum.accumulate(values)
    fresh = np.concatenate(([True], values[1:] < lowest[:-1]))
    return np.maximum.accumulate(np.where(fresh, np.arange(len(values)), 0))


def _frechet(p: Floats, ends: Ints, tolerance: float) -> Bools:
    """Return for each j in ``ends`` whether p[0..j] is within ``tolerance`` of its segment.

    The ball about every point between cuts an interval out of the segment; walking them in order
    must never have to go back. All ends are tested at once: rows are ends, columns points between.
    """
    rays = p[1 : ends.max()] - p[0]
    chords = p[ends] - p[0]
    length = np.sqrt((chords**2).sum(axis=1))[:, None]
    units = np.divide(chords, length, out=np.zeros_like(chords), where=length > 0)
    along = units @ rays.T
    # distance from the line by subtraction of vectors, not of squares: exact on straight paths
    across_sq = np.zeros_like(along)
    for axis in range(p.shape[1]):
        across_sq += (rays[:, axis] - along * units[:, axis, None]) ** 2
    room = tolerance**2 - across_sq
    half = np.sqrt(np.maximum(room, 0.0))
    between = np.arange(1, ends.max()) < ends[:, None]
    low = np.where(between, np.maximum(along - half, 0.0), 0.0)
    high = np.where(between, np.minimum(along + half, length), np.inf)
    met = np.where(between, room >= 0.0, True)
    walked = np.maximum.accumulate(low, axis=1) <= high
    return np.logical_and.reduce(met & walked, axis=1)
