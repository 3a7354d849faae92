"""Smoothing thin-plate spline through scattered heights, and its error by cross-validation.

A thin plate through the samples that are left tells the height of one that is left out; what it
is off by holds the error of interpolation, which no scatter about a plate through all samples does.
Leaving out those around it as well shows how the error grows with the distance to what is known.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, readonly

STIFFNESSES = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0)  # smoothing of the plate that is tried
FOLDS = 5
MOST_FOR_CHOICE = 500  # samples that take part in choosing the stiffness, or are left out
GLOBAL_LIMIT = 2500  # beyond this many samples, only the nearest ones hold the plate
NEIGHBOURS = 80
HOLES_MM = (0.0, 1.0, 1.5, 2.0, 2.5)  # left out around a sample; a cell is no further from one
WITNESSES = 24  # samples that predict the one left out
LOOKED_AT = 150  # nearest samples, those in the hole among them
LEAST_PREDICTED = 10  # samples that tell an error


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


@dataclass(frozen=True, slots=True, eq=False)
class LeftOutError:
    """RMS error (k,) of predicted heights, by the mean distance (k,) to the nearest sample left."""

    distance_mm: Floats  # ascending
    rms_mm: Floats  # never falling

    def at(self, distance_mm: Floats) -> Floats:
        """Return the RMS error at distances to the nearest sample, any shape."""
        return np.asarray(np.interp(distance_mm, self.distance_mm, self.rms_mm), dtype=np.float64)


def left_out_error(places_mm: Floats, heights_mm: Floats) -> LeftOutError:
    """Return how far a thin plate errs at samples that it does not know.

    The plate is as stiff as that of the map. The error holds that of the sample left out as well:
    what a map says of a place is no worse.

    Args:
        places_mm: Where the samples lie (n, 2).
        heights_mm: Their heights (n,).

    Returns:
        Errors by distance; infinite at any distance where there are too few samples to tell.
    """
    n = len(places_mm)
    k = min(WITNESSES, n // 2)
    if k < 4:
        return LeftOutError(readonly(np.zeros(1)), readonly(np.full(1, np.inf)))
    stiffness = chosen_stiffness(places_mm, heights_mm, np.ones(n))
    some = np.arange(0, n, max(1, n // MOST_FOR_CHOICE))
    away, near = KDTree(places_mm).query(places_mm[some], k=min(LOOKED_AT, n))
    found: list[tuple[float, float]] = []
    for hole_mm in HOLES_MM:
        remaining = away > hole_mm  # never the sample itself, which is 0 away
        enough = np.flatnonzero(remaining.sum(axis=1) >= k)
        if len(enough) < LEAST_PREDICTED:
            continue
        errors: list[float] = []
        for row in enough:
            witnesses = np.asarray(near)[row, remaining[row]][:k]
            plate = _plate(places_mm[witnesses], heights_mm[witnesses], np.full(k, stiffness))
            predicted = float(plate(places_mm[some[row]][None])[0])
            errors.append(float(heights_mm[some[row]]) - predicted)
        nearest = float(np.where(remaining[enough], away[enough], np.inf).min(axis=1).mean())
        if not found or nearest > found[-1][0]:  # on a regular grid two holes may be alike
            found.append((nearest, float(np.sqrt(np.mean(np.square(errors))))))
    if not found:
        return LeftOutError(readonly(np.zeros(1)), readonly(np.full(1, np.inf)))
    distance, rms = np.array(found).T
    return LeftOutError(readonly(distance), readonly(np.maximum.accumulate(rms)))
