"""Plain and slow ways to simplify a path, to compare the fast ones with."""

import itertools

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.path.simplification.error_bound import as_path

TIE_MM = 1e-9


def segment_distances(piece: Floats) -> Floats:
    """Return the distance (k,) of each point of a piece from the segment between its ends."""
    span = piece[-1] - piece[0]
    share = np.clip((piece - piece[0]) @ span / max(float(span @ span), 1e-300), 0.0, 1.0)
    return np.linalg.norm(piece - piece[0] - share[:, None] * span, axis=1)


def segment_deviation_mm(points: Floats, index: Ints) -> float:
    """Return the largest distance of a point from the segment that replaces it."""
    pieces = itertools.pairwise(index)
    return max(float(segment_distances(points[a : b + 1]).max()) for a, b in pieces)


def textbook_order(points: Floats, tolerance: float) -> list[int] | None:
    """Return the points that the greedy removes, in order, by looking at all in every step.

    None where two removals cost the same: a rule decides then, and rounding with it.
    """
    kept, order = list(range(len(points))), []
    while len(kept) > 2:
        costs = np.array(
            [
                segment_distances(points[a : b + 1]).max()
                for a, b in zip(kept[:-2], kept[2:], strict=True)
            ]
        )
        least = int(costs.argmin())
        if costs[least] > tolerance:
            break
        if (np.abs(costs - costs[least]) < TIE_MM).sum() > 1:
            return None
        order.append(kept.pop(least + 1))
    return order


def fewest(points: Floats, tolerance: float, *, frechet: bool) -> int:
    """Return the least number of points, by trying every segment."""
    n = len(points)
    steps = np.full(n, n)
    steps[0] = 0
    for i in range(n - 1):
        good = _frechet(points[i:], tolerance) if frechet else _near(points[i:], tolerance)
        ends = i + 1 + np.flatnonzero(good)
        steps[ends] = np.minimum(steps[ends], steps[i] + 1)
    return int(steps[-1]) + 1


def _near(points: Floats, tolerance: float) -> Bools:
    """Return for every end (k - 1,) whether all between lie near the segment from the start."""
    rays = points[1:] - points[0]
    length_sq = np.maximum((rays**2).sum(axis=1), 1e-300)
    share = np.clip(rays @ rays.T / length_sq[:, None], 0.0, 1.0)
    away = np.linalg.norm(rays[None] - share[..., None] * rays[:, None], axis=2)
    return np.where(np.tri(len(rays), dtype=np.bool_), away, 0.0).max(axis=1) <= tolerance


def _frechet(points: Floats, tolerance: float) -> Bools:
    """Return the same in the sense of Fréchet: the balls are met in order, never going back."""
    rays = points[1:] - points[0]
    length = np.linalg.norm(rays, axis=1)[:, None]
    units = np.divide(rays, length, out=np.zeros_like(rays), where=length > 0)
    along = units @ rays.T
    away = np.linalg.norm(rays[None] - along[..., None] * units[:, None], axis=2)
    half = np.sqrt(np.maximum(tolerance**2 - away**2, 0.0))
    between = np.tri(len(rays), k=-1, dtype=np.bool_)
    low = np.where(between, np.maximum(along - half, 0.0), 0.0)
    high = np.where(between, np.minimum(along + half, length), np.inf)
    walked = np.maximum.accumulate(low, axis=1) <= high
    return (walked & (~between | (away <= tolerance))).all(axis=1)


def within_frechet(points: ArrayLike, index: ArrayLike, tolerance: float) -> bool:
    """Return whether each piece stays within ``tolerance`` of its segment in the sense of Fréchet.

    One piece and one point after the other: slow and plain, to check what is fast.

    Args:
        points: Original path (n, m).
        index: Indices (k,) of the points kept, as in :func:`deviations`.
        tolerance: Bound in mm.
    """
    p = as_path(points)
    kept = np.asarray(index)
    for a, b in itertools.pairwise(kept.tolist()):
        chord = p[b] - p[a]
        length_sq, at = float(chord @ chord), 0.0
        for q in p[a + 1 : b] - p[a]:
            # the share t of the segment where |q - t chord| <= tolerance
            if length_sq == 0.0:
                if float(q @ q) > tolerance**2:
                    return False
                continue
            foot = float(q @ chord) / length_sq
            away = q - foot * chord
            room = tolerance**2 - float(away @ away)
            if room < 0.0:
                return False
            half = float(np.sqrt(room / length_sq))
            at = max(at, foot - half)
            if at > min(foot + half, 1.0):
                return False
    return True
