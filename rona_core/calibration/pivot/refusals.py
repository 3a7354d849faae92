"""Why poses determine no tip: each cause with its words and its remedy."""

import numpy as np

from rona_core.calibration.pivot.initial_guess import robust_initial_guess
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats

REFUSALS: dict[str, tuple[str, str]] = {  # cause: words, remedy
    "still": (
        "the marker hardly turned ({degrees:.2g} degrees)",
        "swing it about its tip",
    ),
    "repeated": (
        "only {n} of {all} poses differ from the one before, {least} are needed",
        "keep the marker in view of the tracker, which repeats its last pose, and swing on",
    ),
    "one plane": (
        "the swing stays in one plane ({strongest:.1f} degrees one way, {weakest:.2g} the other)",
        "swing in two directions",
    ),
    "small": (
        "the swing covers only about {degrees:.1f} degrees half-angle, {least:.0f} are needed",
        "swing further, to 20 degrees and more",
    ),
    "narrow": (
        "the swing covers a cone of only {degrees:.1f} degrees half-angle, {least:.0f} are needed",
        "swing further, to 20 degrees and more",
    ),
    "slipped": (
        "the tip has slipped: up to pose {row} it was {distance:.1f} mm from where it was then",
        "hold it in one place and swing again, or use only the poses before that or only those "
        "after it",
    ),
    "loose": (
        "the marker has moved on its tool: up to pose {row} the tip was {distance:.1f} mm from "
        "where it was in the marker then",
        "fasten the marker and swing again, or use only the poses before that or only those after "
        "it",
    ),
    "disagree": (
        "{n} of {all} poses disagree with the tip that the others share, here and there",
        "look for reflections, for markers that were covered or exchanged, and leave such poses "
        "out",
    ),
    "no common tip": (
        "the poses share no tip: where it fits best, it scatters by {scatter:.1f} mm",
        "rest the tip in one place, fasten the marker to its tool, and use poses of this marker "
        "in the tracker",
    ),
    "behind": (
        "the tip lies {distance:.1f} mm behind the markers",
        "turn the z axis of the marker, which must point to the tip",
    ),
}
AGREE_MM = 3.0  # the tip scatters less (median) where it stayed in one place
APART = 4.0  # scatters by which two places are different ones
FITS = 0.8  # of the poses agree with one of two places
SPLITS = np.linspace(0.1, 0.9, 17)  # of the motion, where a move is looked for


def refusal(cause: str, **figures: float) -> DegenerateGeometryError:
    """Return the error of a cause; its ``data`` has the cause, as in `REFUSALS`."""
    words, remedy = REFUSALS[cause]
    return DegenerateGeometryError(f"{words.format(**figures)}: {remedy}", cause=cause)


def disagreement(
    levers: Floats, p: Floats, keep: Bools, scatter_mm: float | None = None
) -> DegenerateGeometryError:
    """Return why too few poses share a tip: it moved at one time, some poses are wrong, or all.

    Args:
        levers: (n, 3, k) directions, in ``tracker``, of the k ways in which the tip may move.
        p: (n, 3) where each pose puts the origin of these ways, in mm.
        keep: (n,) poses that may count.
        scatter_mm: Of the tip about its pivot, where a fit has one; else a median.
    """
    rows = np.flatnonzero(keep)
    levers, p = levers[rows], p[rows] - p[rows].mean(axis=0)
    moved = np.broadcast_to(-np.eye(3), (len(p), 3, 3))
    for cause, ways in (("slipped", moved), ("loose", levers)):
        found = _moved_once(levers, p, ways)
        if found is not None:
            return refusal(cause, row=int(rows[found[0] - 1]), distance=found[1])
    whole = robust_initial_guess(levers, p, np.ones(len(p), dtype=np.bool_))
    misses = _misses(levers, p, whole)
    scatter = float(np.median(misses))
    out = int((misses > APART * scatter).sum())
    if scatter <= AGREE_MM and out:
        return refusal("disagree", n=out, all=len(rows))
    return refusal("no common tip", scatter=scatter if scatter_mm is None else scatter_mm)


def _moved_once(levers: Floats, p: Floats, ways: Floats) -> tuple[int, float] | None:
    """Return after how many poses tip or pivot moved (ways (n, 3, j)) and how far; None if not."""
    n, j = len(p), ways.shape[2]
    everywhere, order = np.ones(n, dtype=np.bool_), np.arange(n)
    best: tuple[float, Floats] | None = None
    for split in np.unique((SPLITS * n).astype(np.int64)):
        after = np.where((order >= split)[:, None, None], ways, 0.0)
        x = robust_initial_guess(np.concatenate((levers, after), axis=2), p, everywhere)
        left = _misses(np.concatenate((levers, after), axis=2), p, x)
        cost = float(np.minimum(left, AGREE_MM).sum())
        if best is None or cost < best[0]:
            best = cost, x
    if best is None:
        return None
    x = best[1]
    without = _misses(levers, p, np.delete(x, np.s_[-3 - j : -3]))
    within = _misses(np.concatenate((levers, ways), axis=2), p, x)
    # the first k poses without the move, the others with it
    bounded = np.minimum(np.stack((without, within)), AGREE_MM * APART)
    costs = np.append(0.0, bounded[0].cumsum()) + np.append(bounded[1][::-1].cumsum()[::-1], 0.0)
    k = int(costs.argmin())
    left = np.where(order < k, without, within)
    scatter = float(np.median(left))
    distance = float(np.linalg.norm(x[-3 - j : -3]))
    agree = float((left <= APART * max(scatter, 1e-6)).mean())
    if not 0 < k < n or scatter > AGREE_MM or agree < FITS or distance < APART * scatter:
        return None
    return k, distance


def _misses(levers: Floats, p: Floats, x: Floats) -> Floats:
    return np.linalg.norm(levers @ x[:-3] + p - x[-3:], axis=1)
