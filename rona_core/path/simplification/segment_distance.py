"""Distances from points to segments, and area between a path and a segment.

All work in any dimension: points are (k, m), the ends of a segment (m,) or one each (k, m). Sums
over the dimensions run column by column, so one piece alone gives the bits it gives among many.
"""

from typing import Literal

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints

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
