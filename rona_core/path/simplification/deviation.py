"""Deviation of a simplified path from its original: the paper's K1, K2 and K3.

Written apart from the simplifier, so that it can check it. A piece is the original points from one
kept point to the next, both included; a figure of a path is that of its worst piece.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, as_floats
from rona_core.path.simplification.segment_distance import (
    distances_to_segment,
    feet_on_segment,
    strip_areas,
)


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
