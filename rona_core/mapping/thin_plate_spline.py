"""Smoothing thin-plate spline through scattered heights."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats

STIFFNESSES = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0)  # smoothing of the plate that is tried
MIDDLE = 2  # the one that is tried first
FOLDS = 5
MOST_FOR_CHOICE = 500  # samples that take part in choosing the stiffness
GLOBAL_LIMIT = 2500  # samples of one plate; where there are more, each block of places has its own
BLOCK, PATCH = 150, 600  # samples in a block on average, and nearest ones that hold its plate


@dataclass(frozen=True, slots=True, eq=False)
class PlateFit:
    """A fitted plate: heights at any place, and the scatter of the samples about it."""

    plate: Callable[[Floats], Floats]  # places (m, 2) -> heights (m,)
    places_mm: Floats  # (n, 2)
    residuals_mm: Floats  # (n,)
    stiffness: float

    def heights(self, places_mm: Floats) -> Floats:
        """Return the heights (m,) at places (m, 2)."""
        return np.asarray(self.plate(places_mm), dtype=np.float64)


def fit_plate(
    places_mm: Floats,
    heights_mm: Floats,
    relative_variance: Floats | None = None,
    stiffness: float | None = None,
) -> PlateFit:
    """Return the thin plate through samples, smoothed as cross-validation finds best.

    Args:
        places_mm: Where the samples lie (n, 2), n >= 4.
        heights_mm: Their heights (n,).
        relative_variance: How much less a sample counts than a perfect one (n,); 1 if not given.
        stiffness: Smoothing to use; None lets the samples choose.
    """
    weights = np.ones(len(heights_mm)) if relative_variance is None else relative_variance
    chosen = chosen_stiffness(places_mm, heights_mm, weights) if stiffness is None else stiffness
    plate = _plate(places_mm, heights_mm, chosen * weights)
    left = heights_mm - np.asarray(plate(places_mm))
    return PlateFit(plate, places_mm, left, float(chosen))


def _plate(places: Floats, heights: Floats, smoothing: Floats) -> Callable[[Floats], Floats]:
    if len(heights) > GLOBAL_LIMIT:
        return _patches(places, heights, smoothing)
    return RBFInterpolator(
        places,
        heights,
        smoothing=smoothing,  # pyright: ignore[reportArgumentType]  # one for each sample
        kernel="thin_plate_spline",
    )


def _patches(places: Floats, heights: Floats, smoothing: Floats) -> Callable[[Floats], Floats]:
    """Return plates side by side: time grows with the number of samples, not with its cube."""
    tree = KDTree(places)
    side_mm = np.sqrt(BLOCK * np.ptp(places, axis=0).prod() / len(places))

    def heights_at(wanted: Floats) -> Floats:
        found = np.zeros(len(wanted))
        blocks, number, counts = np.unique(
            np.floor(wanted / side_mm), axis=0, return_inverse=True, return_counts=True
        )
        members = np.split(np.argsort(number, kind="stable"), np.cumsum(counts)[:-1])
        for block, rows in zip(blocks, members, strict=True):
            near = tree.query((block + 0.5) * side_mm, k=PATCH)[1]
            found[rows] = _plate(places[near], heights[near], smoothing[near])(wanted[rows])
        return found

    return heights_at


def chosen_stiffness(places: Floats, heights: Floats, weights: Floats) -> float:
    """Return the stiffness whose plate predicts left-out samples best.

    The error falls to one minimum and rises again, so that it is followed downhill from the middle
    and half of the plates need not be solved.

    Args:
        places: Where the samples lie (n, 2), in mm.
        heights: Their heights (n,), in mm.
        weights: How much less a sample counts than a perfect one (n,).
    """
    n = len(heights)
    if n < 4 * FOLDS:
        return 1.0
    step = max(1, n // MOST_FOR_CHOICE)
    rows = np.arange(0, n, step)
    places, heights, weights = places[rows], heights[rows], weights[rows]
    # neighbours along the path are left out together, or the noise they share looks like shape
    fold = (np.arange(len(rows)) // 4) % FOLDS

    def error(stiffness: float) -> float:
        left = np.zeros(len(rows))
        for k in range(FOLDS):
            out = fold == k
            plate = _plate(places[~out], heights[~out], stiffness * weights[~out])
            left[out] = heights[out] - np.asarray(plate(places[out]))
        return float(np.sum(np.abs(left) / np.sqrt(weights)))

    at = MIDDLE
    least = error(STIFFNESSES[at])
    for way in (-1, 1):
        while 0 <= at + way < len(STIFFNESSES):
            found = error(STIFFNESSES[at + way])
            if found >= least:
                break
            at, least = at + way, found
        if at != MIDDLE:
            break
    return STIFFNESSES[at]
