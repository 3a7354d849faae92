"""Smoothing thin-plate spline through scattered heights, its stiffness by cross-validation."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator

from rona_core.geometry.arrays import Floats

STIFFNESSES = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0)  # smoothing of the plate that is tried
FOLDS = 5
MOST_FOR_CHOICE = 500  # samples that take part in choosing the stiffness
GLOBAL_LIMIT = 2500  # beyond this many samples, only the nearest ones hold the plate
NEIGHBOURS = 80


@dataclass(frozen=True, slots=True, eq=False)
class PlateFit:
    """A fitted plate: heights at any place, and the scatter of the samples about it."""

    plate: RBFInterpolator
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


def _plate(places: Floats, heights: Floats, smoothing: Floats) -> RBFInterpolator:
    neighbours = NEIGHBOURS if len(heights) > GLOBAL_LIMIT else None
    return RBFInterpolator(
        places,
        heights,
        neighbors=neighbours,
        smoothing=smoothing,  # pyright: ignore[reportArgumentType]  # one for each sample
        kernel="thin_plate_spline",
    )


def chosen_stiffness(places: Floats, heights: Floats, weights: Floats) -> float:
    """Return the stiffness whose plate predicts left-out samples best.

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
    errors = []
    for stiffness in STIFFNESSES:
        left = np.zeros(len(rows))
        for k in range(FOLDS):
            out = fold == k
            plate = _plate(places[~out], heights[~out], stiffness * weights[~out])
            left[out] = heights[out] - np.asarray(plate(places[out]))
        errors.append(float(np.sum(np.abs(left) / np.sqrt(weights))))
    return STIFFNESSES[int(np.argmin(errors))]
