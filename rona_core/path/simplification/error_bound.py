"""Deviation of a simplified path from its original, and the bound that segments have to keep.

Distances from points to segments, and area between a path and a segment. All work in any dimension:
points are (k, m), the ends of a segment (m,) or one each (k, m). Sums over the dimensions run
column by column, so one piece alone gives the bits it gives among many.

Deviation of a simplified path from its original: the paper's K1, K2 and K3. Written apart from the
simplifier, so that it can check it. A piece is the original points from one kept point to the next,
both included; a figure of a path is that of its worst piece.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, as_floats

Metric = Literal["k1", "k2", "k3"]
METRICS: tuple[Metric, ...] = ("k1", "k2", "k3")
MAX_AT_ONCE = 400_000  # originals in one go, so that the working memory stays small
_roots, _weights = np.polynomial.legendre.leggauss(3)
NODES, WEIGHTS = (_roots + 1.0) / 2.0, _weights / 2.0  # of Gauss's rule on 0 to 1


def as_metric(metric: str) -> Metric:
    """Return ``metric`` after checking its name."""
    for known in METRICS:
        if metric == known:
            return known
    raise InvalidInputError(f"metric must be one of {', '.join(METRICS)}, not {metric!r}")


def dot(a: Floats, b: Floats) -> Floats:
    """Return the scalar products (...) over the last axis, summed in its order."""
    total = a[..., 0] * b[..., 0]
    for axis in range(1, a.shape[-1]):
        total = total + a[..., axis] * b[..., axis]
    return total


def feet_on_segment(points: Floats, start: Floats, end: Floats) -> Floats:
    """Return the place (k, m) nearest to each point on the segment ``start`` to ``end``."""
    along = end - start
    length_sq = dot(along, along)
    t = dot(points - start, along) / np.where(length_sq > 0, length_sq, 1.0)
    return start + np.clip(t, 0.0, 1.0)[..., None] * along


def distances_to_segment(points: Floats, start: Floats, end: Floats) -> Floats:
    """Return the distance (k,) of each point from the segment; to its start if it has no length."""
    away = points - feet_on_segment(points, start, end)
    return np.sqrt(dot(away, away))


def piece_costs(columns: Floats, starts: Ints, ends: Ints, metric: Metric) -> Floats:
    """Return the deviation (q,) of each piece of a path from the segment between its ends.

    Args:
        columns: The path as (m, n), one row per dimension.
        starts: Index (q,) of the first original of each piece.
        ends: Index (q,) of its last; nothing between gives 0.
        metric: "k1" largest distance, "k2" root mean square, "k3" area.
    """
    costs = np.zeros(len(starts))
    for some in batches(starts, ends):
        if metric == "k3":
            costs[some] = _areas(columns, starts[some], ends[some])
        else:
            costs[some] = _distances(columns, starts[some], ends[some], metric)
    return costs


def batches(starts: Ints, ends: Ints) -> list[Ints]:
    """Return the numbers of the pieces with originals between their ends, some at a time."""
    busy = np.flatnonzero(ends - starts > 1)
    work = np.cumsum(ends[busy] - starts[busy])
    if not len(busy) or work[-1] < MAX_AT_ONCE:
        return [busy] if len(busy) else []
    return np.split(busy, np.flatnonzero(np.diff(work // MAX_AT_ONCE)) + 1)


def inner_rows(starts: Ints, ends: Ints) -> tuple[Ints, Ints, Ints]:
    """Return the originals between the ends of all pieces in a row.

    Returns:
        Index of each original, number of originals of each piece, and where each piece begins.
    """
    counts = ends - starts - 1
    first = np.cumsum(counts) - counts
    return np.arange(int(counts.sum())) + np.repeat(starts + 1 - first, counts), counts, first


def _distances(columns: Floats, starts: Ints, ends: Ints, metric: Metric) -> Floats:
    rows, counts, first = inner_rows(starts, ends)
    length_sq, share = np.zeros(len(starts)), np.zeros(len(rows))
    rays: list[Floats] = []
    chords: list[Floats] = []
    for column in columns:
        origin = column[starts]
        chord = column[ends] - origin
        length_sq = length_sq + chord * chord
        chords.append(np.repeat(chord, counts))
        rays.append(column[rows] - np.repeat(origin, counts))
        share += rays[-1] * chords[-1]
    share /= np.repeat(np.where(length_sq > 0, length_sq, 1.0), counts)
    np.clip(share, 0.0, 1.0, out=share)
    away_sq = np.zeros(len(rows))
    for ray, chord in zip(rays, chords, strict=True):
        chord *= share
        ray -= chord
        ray *= ray
        away_sq += ray
    if metric == "k1":
        return np.sqrt(np.maximum.reduceat(away_sq, first))
    return np.sqrt(np.add.reduceat(away_sq, first) / (counts + 2))


def _areas(columns: Floats, starts: Ints, ends: Ints) -> Floats:
    """Return the strip areas of pieces; every step of the path belongs to one piece."""
    rows, counts, first = inner_rows(starts - 1, ends)  # all but the last of each piece
    a = np.repeat(columns[:, starts], counts, axis=1).T
    b = np.repeat(columns[:, ends], counts, axis=1).T
    here, there = columns[:, rows].T, columns[:, rows + 1].T
    areas = strip_areas(here, there, feet_on_segment(here, a, b), feet_on_segment(there, a, b))
    return np.add.reduceat(areas, first)


def strip_areas(here: Floats, there: Floats, foot_here: Floats, foot_there: Floats) -> Floats:
    """Return the area (k,) between steps of a path ``here`` to ``there`` and those of its feet.

    Lines from points to feet rule the strip. It is cut where the two steps come closest, so that
    crossing paths count both sides, and integrated by Gauss: exact where the strip is flat.
    """
    step, foot_step = there - here, foot_there - foot_here
    gap, change = foot_here - here, foot_step - step
    change_sq = dot(change, change)
    cut = np.clip(-dot(gap, change) / np.where(change_sq > 0, change_sq, 1.0), 0.0, 1.0)
    along = [(1.0 - node) * step + node * foot_step for node in NODES]
    total = np.zeros(len(step))
    for start, width in ((np.zeros_like(cut), cut), (cut, 1.0 - cut)):
        for node, weight in zip(NODES, WEIGHTS, strict=True):
            ruling = gap + (start + node * width)[:, None] * change
            for v, other in zip(along, WEIGHTS, strict=True):
                total += weight * other * width * _parallelogram_areas(ruling, v)
    return total


def _parallelogram_areas(u: Floats, v: Floats) -> Floats:
    """Return the area (k,) spanned by each pair of vectors (k, m), in any dimension."""
    u_sq = dot(u, u)
    share = dot(u, v) / np.where(u_sq > 0, u_sq, 1.0)
    across = v - share[:, None] * u
    return np.sqrt(u_sq * dot(across, across))


@dataclass(frozen=True, slots=True)
class Deviations:
    """The worst piece of a simplified path by each measure."""

    k1_mm: float  # largest distance of the originals from the replacing segment
    k2_mm: float  # root of their mean squared distance
    k3_mm2: float  # area between the original and the segment
    where: int  # index of the original point with the largest distance


def deviations(points: ArrayLike, index: ArrayLike) -> Deviations:
    """Return K1, K2 and K3 of the path that keeps ``points[index]``.

    K1 is also the Hausdorff distance, in both directions, of the continuous piece from its
    segment: the distance from a segment is convex, so the corners are the farthest, and every
    place of the segment lies below some place of the piece.

    Args:
        points: Original path (n, m), any m, in mm.
        index: Increasing indices (k,) of the points kept, first and last among them.

    Raises:
        InvalidInputError: wrong shapes, or indices that do not start at 0, increase, and end.
    """
    p = as_path(points)
    kept = _as_index(index, len(p))
    if len(kept) < 2:
        return Deviations(0.0, 0.0, 0.0, 0)
    piece = np.clip(np.searchsorted(kept, np.arange(len(p)), side="right") - 1, 0, len(kept) - 2)
    start, end = p[kept[piece]], p[kept[piece + 1]]
    distances = distances_to_segment(p, start, end)
    distances[kept] = 0.0  # by definition, whatever rounding says
    sizes = np.diff(kept) + 1.0
    sums = np.add.reduceat(distances**2, kept[:-1])  # the last of each piece adds nothing
    start, end = start[:-1], end[:-1]  # every step belongs to the piece that it begins in
    feet = (feet_on_segment(q, start, end) for q in (p[:-1], p[1:]))
    areas = np.add.reduceat(strip_areas(p[:-1], p[1:], *feet), kept[:-1])
    areas[np.diff(kept) == 1] = 0.0
    return Deviations(
        k1_mm=float(distances.max()),
        k2_mm=float(np.sqrt((sums / sizes).max())),
        k3_mm2=float(areas.max()),
        where=int(distances.argmax()),
    )


def as_path(points: ArrayLike) -> Floats:
    """Return a path (n, m) with n >= 1 and m >= 1 as finite float64.

    Raises:
        InvalidInputError: another shape, or values that are not finite.
    """
    p = as_floats(points, name="points")
    if p.ndim != 2 or not len(p) or not p.shape[1]:
        raise InvalidInputError(f"a path must have shape (n, m) with n, m >= 1, not {p.shape}")
    return p


def _as_index(index: ArrayLike, n: int) -> Ints:
    kept = np.asarray(index)
    whole = kept.ndim == 1 and len(kept) > 0 and np.issubdtype(kept.dtype, np.integer)
    if not whole or kept[0] != 0 or kept[-1] != n - 1 or (np.diff(kept) <= 0).any():
        raise InvalidInputError(f"index must increase from 0 to {n - 1}")
    return kept.astype(np.int64)


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
