"""Measure how far a simplified path is from its original: the paper's K1, K2 and K3.

Written apart from the simplifier, so that it can check it. A piece is the original points from one
kept point to the next, both included; a figure of a path is that of its worst piece.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import Floats, Ints, as_floats
from rona_core.errors import InvalidInputError
from rona_core.path.segment import distances_to_segment, feet_on_segment, strip_areas

Metric = Literal["k1", "k2", "k3"]
METRICS: tuple[Metric, ...] = ("k1", "k2", "k3")


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
    areas = [
        float(strip_areas(q, feet_on_segment(q, q[0], q[-1])).sum())
        for a, b in pairwise(kept)
        if len(q := p[a : b + 1]) > 2
    ]
    return Deviations(
        k1_mm=float(distances.max()),
        k2_mm=float(np.sqrt((sums / sizes).max())),
        k3_mm2=max(areas, default=0.0),
        where=int(distances.argmax()),
    )


def deviation(points: ArrayLike, index: ArrayLike, metric: Metric = "k1") -> float:
    """Return one figure of :func:`deviations`: mm for "k1" and "k2", mm^2 for "k3"."""
    found = deviations(points, index)
    return {"k1": found.k1_mm, "k2": found.k2_mm, "k3": found.k3_mm2}[as_metric(metric)]


def as_metric(metric: str) -> Metric:
    """Return ``metric`` after checking its name."""
    for known in METRICS:
        if metric == known:
            return known
    raise InvalidInputError(f"metric must be one of {', '.join(METRICS)}, not {metric!r}")


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
