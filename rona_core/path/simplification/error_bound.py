"""Error bound of a simplified path, and the test whether a segment may replace a piece."""

from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.path.simplification.segment_distance import (
    Metric,
    as_metric,
    batches,
    inner_rows,
    piece_costs,
)


def pieces_within(columns: Floats, starts: Ints, ends: Ints, tolerance: float) -> Bools:
    """Return for each piece (q,) whether it is within ``tolerance`` of its segment.

    Args:
        columns: The path as (m, n), one row per dimension.
        starts: Index (q,) of the first original of each piece.
        ends: Index (q,) of its last.
        tolerance: Bound in the unit of the path.
    """
    within = np.ones(len(starts), dtype=np.bool_)
    for some in batches(starts, ends):
        within[some] = _within(columns, starts[some], ends[some], tolerance)
    return within


def _within(columns: Floats, starts: Ints, ends: Ints, tolerance: float) -> Bools:
    rows, counts, first = inner_rows(starts, ends)
    chords = columns[:, ends] - columns[:, starts]
    length = np.sqrt((chords**2).sum(axis=0))
    units = np.divide(chords, length, out=np.zeros_like(chords), where=length > 0)
    along, across_sq = np.zeros(len(rows)), np.zeros(len(rows))
    rays = [column[rows] - np.repeat(column[starts], counts) for column in columns]
    spread = [np.repeat(unit, counts) for unit in units]
    for ray, unit in zip(rays, spread, strict=True):
        along += ray * unit
    for ray, unit in zip(rays, spread, strict=True):
        # distance from the line by subtraction of vectors, not of squares: exact on straight paths
        ray -= along * unit
        ray *= ray
        across_sq += ray
    slack = tolerance**2 - across_sq
    half = np.sqrt(np.maximum(slack, 0.0))
    low = np.maximum(along - half, 0.0)
    high = np.minimum(along + half, np.repeat(length, counts))
    good = np.logical_and.reduceat((slack >= 0.0) & (low <= high), first)
    back = np.append(along[1:] < along[:-1], False)
    back[first[1:] - 1] = False  # from one piece to the next is no step
    unsure = good & np.logical_or.reduceat(back, first)
    if unsure.any():  # pieces whose feet only go forward need no walk
        walking, some = np.repeat(unsure, counts), counts[unsure]
        walked = _farthest_so_far(low[walking], some) <= high[walking]
        good[unsure] = np.logical_and.reduceat(walked, np.cumsum(some) - some)
    return good


def _farthest_so_far(values: Floats, counts: Ints) -> Floats:
    """Return the running maximum of ``values``, begun afresh with every piece, without rounding."""
    order = np.argsort(values, kind="stable")
    rank = np.zeros(len(values), dtype=np.int64)
    rank[order] = np.arange(len(values))
    offset = np.repeat(np.arange(len(counts)) * len(values), counts)
    return values[order[np.maximum.accumulate(rank + offset) - offset]]


ROUNDING = 16.0 * np.finfo(np.float64).eps  # of the largest coordinate: deviations below are none


def rounding_of(points: Floats, metric: Metric) -> float:
    """Return the deviation that rounding of the coordinates makes of a straight path."""
    size = float(np.abs(points).max())
    return ROUNDING * size * (size if metric == "k3" else 1.0)


@dataclass(frozen=True, slots=True)
class ErrorBound:
    """Error bound of a simplified path; it holds in each replaced piece.

    Only "k1" bounds the distance itself; beside "k2" and "k3" a cap may.
    """

    tolerance: float  # mm, or mm^2 for "k3"
    metric: Metric = "k1"  # "k1" largest distance, "k2" root mean square, "k3" area
    frechet: bool = True  # distance of Fréchet: strokes that run back and forth stay; False: K1
    cap_mm: float | None = None  # on the distance, beside "k2" or "k3"

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            InvalidInputError: unknown metric, a bound below 0, or a cap beside "k1".
        """
        as_metric(self.metric)
        if not 0.0 <= self.tolerance < np.inf:
            raise InvalidInputError(f"tolerance must be 0 or more, not {self.tolerance}")
        if self.cap_mm is not None and (self.metric == "k1" or not self.cap_mm >= 0.0):
            raise InvalidInputError(
                f"cap_mm must be 0 or more, and beside k2 or k3, not {self.cap_mm} beside "
                f"{self.metric}"
            )

    def shortcut_test(self, points: Floats) -> "ShortcutTest":
        """Return the test of the shortcuts of a path (n, m)."""
        near = float(self.tolerance) if self.metric == "k1" else self.cap_mm
        return ShortcutTest(
            self.metric,
            float(self.tolerance),
            np.inf if near is None else float(near),
            self.frechet,
            rounding_of(points, self.metric),
        )


@dataclass(frozen=True, slots=True)
class ShortcutTest:
    """Test of shortcuts (Imai 1988): is a piece of a path close enough to its segment?"""

    metric: Metric
    tolerance: float  # mm, or mm^2 for "k3"
    near_mm: float  # bound on the distance; the tolerance for "k1", infinite for none
    frechet: bool  # the distance in the sense of Fréchet, not only K1
    rounding: float  # deviations up to it are none, see :func:`rounding_of`

    @property
    def bounds_frechet(self) -> bool:
        """Whether the distance is bounded in the sense of Fréchet."""
        return self.frechet and self.near_mm < np.inf

    def costs(self, columns: Floats, starts: Ints, ends: Ints) -> Floats:
        """Return the measure (q,) of each piece; what rounding makes of a straight one is 0."""
        costs = piece_costs(columns, starts, ends, self.metric)
        costs[costs <= self.rounding] = 0.0
        return costs

    def allows(self, columns: Floats, starts: Ints, ends: Ints) -> Bools:
        """Return for each piece (q,) whether its distance is within the bound."""
        if self.bounds_frechet:
            return pieces_within(columns, starts, ends, self.near_mm)
        if self.near_mm < np.inf:
            return piece_costs(columns, starts, ends, "k1") <= self.near_mm
        return np.ones(len(starts), dtype=np.bool_)

    def holds(self, columns: Floats, starts: Ints, ends: Ints) -> Bools:
        """Return for each piece (q,) whether a segment may replace it."""
        good = self.allows(columns, starts, ends)
        if self.metric != "k1":
            some = np.flatnonzero(good)
            good[some] = self.costs(columns, starts[some], ends[some]) <= self.tolerance
        good[ends - starts == 1] = True
        return good
