"""Fréchet distance of a path from its simplification, decided point by point: an oracle."""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from rona_core.path.simplification.deviation import as_path


def within_frechet(
    points: ArrayLike, index: ArrayLike, tolerance: float, *, closed: bool = False
) -> bool:
    """Return whether each piece stays within ``tolerance`` of its segment in the sense of Fréchet.

    One piece and one point after the other: slow and plain, to check what is fast.

    Args:
        points: Original path (n, m).
        index: Indices (k,) of the points kept, as in :func:`deviations`.
        tolerance: Bound in mm.
        closed: As in :func:`deviations`.
    """
    p = as_path(points)
    kept = np.asarray(index)
    if closed:
        p = np.roll(p, -kept[0], axis=0)
        p, kept = np.vstack((p, p[:1])), np.append(kept - kept[0], len(p))
    for a, b in pairwise(kept.tolist()):
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
