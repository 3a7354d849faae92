"""Error of a thin plate between its samples, and beyond them, by what it does to left-out samples.

A thin plate is the best linear predictor of a field whose increments have the covariance r² log r
(Wahba 1990), and its standard error at a place follows from where the samples lie: small on a row,
larger between two, larger still beyond the last one. How large that is in millimetres is not known;
samples that are left out, with others around them, tell.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.mapping.thin_plate_spline import chosen_stiffness

WITNESSES = 24  # samples that predict a place
LOOKED_AT = 150  # nearest samples, those in the hole among them
HOLES_MM = (0.0, 1.0, 1.5, 2.0, 2.5)  # left out around a sample; a cell is no further from one
MOST_LEFT_OUT = 500
LEAST_PREDICTED = 10  # left-out samples that tell an error
ROUNDS = 5  # of the fit of both variances
BLOCK = 2000  # places at once


@dataclass(frozen=True, slots=True, eq=False)
class InterpolationError:
    """Standard error of a plate at any place: scale times that of a field of unit increments."""

    places_mm: Floats  # (n, 2) of the samples
    stiffness: float
    scale: float  # infinite where too few samples tell it
    scatter_mm: float  # of a sample about the field

    def at(self, places_mm: Floats) -> Floats:
        """Return the standard error (m,) of the field at places (m, 2), scatter left aside."""
        if not np.isfinite(self.scale):
            return np.full(len(places_mm), np.inf)
        near = _nearest(self.places_mm, places_mm, _witnesses(len(self.places_mm)))[1]
        none = np.zeros(len(self.places_mm))
        return self.scale * _predicted(self.places_mm, none, near, places_mm, self.stiffness)[1]


def interpolation_error(places_mm: Floats, heights_mm: Floats) -> InterpolationError:
    """Return how far a thin plate through samples errs where there is none.

    Squared errors at left-out samples are laid through scatter² + scale² times the squared standard
    error of a unit field, neither below zero, each weighted by what is expected of it.

    Args:
        places_mm: Where the samples lie (n, 2).
        heights_mm: Their heights (n,).

    Returns:
        The error; infinite everywhere where there are too few samples to tell.
    """
    n = len(places_mm)
    known = readonly(np.array(places_mm, dtype=np.float64))
    if n < LEAST_PREDICTED:
        return InterpolationError(known, 1.0, np.inf, np.inf)
    stiffness = chosen_stiffness(places_mm, heights_mm, np.ones(n))
    k = _witnesses(n)
    some = np.arange(0, n, max(1, n // MOST_LEFT_OUT))
    away, near = _nearest(places_mm, places_mm[some], min(LOOKED_AT, n))
    errors: list[Floats] = []
    units: list[Floats] = []
    for hole_mm in HOLES_MM:
        left = away > hole_mm  # never the sample itself, which is 0 away
        enough = left.sum(axis=1) >= k
        if not enough.any():
            continue
        first = np.argsort(~left[enough], axis=1, kind="stable")[:, :k]
        witnesses = np.take_along_axis(near[enough], first, axis=1)
        rows = some[enough]
        found, unit = _predicted(places_mm, heights_mm, witnesses, places_mm[rows], stiffness)
        errors.append(heights_mm[rows] - found)
        units.append(unit)
    if sum(map(len, errors)) < LEAST_PREDICTED:
        return InterpolationError(known, stiffness, np.inf, np.inf)
    scatter, scale = _variances(np.concatenate(errors) ** 2, np.concatenate(units) ** 2) ** 0.5
    return InterpolationError(known, stiffness, float(scale), float(scatter))


def _variances(squares: Floats, units: Floats) -> Floats:
    """Return both variances (2,): that of a sample, and that of a field of unit increments."""
    design = np.column_stack((np.ones(len(units)), units))
    weights, found = np.ones(len(units)), np.zeros(2)
    for _ in range(ROUNDS):
        found = nnls(design * weights[:, None], squares * weights)[0]
        expected = design @ found
        if not expected.max() > 0.0:
            break
        weights = 1.0 / np.maximum(expected, 1e-9 * expected.max())
    return found


def _nearest(places: Floats, wanted: Floats, k: int) -> tuple[Floats, Ints]:
    """Return distances and rows (m, k) of the nearest of places (n, 2) to others (m, 2)."""
    away, rows = KDTree(places).query(wanted, k=k)
    return np.asarray(away, dtype=np.float64), np.asarray(rows, dtype=np.int64)


def _witnesses(n: int) -> int:
    return min(WITNESSES, n // 2)


def _predicted(
    places: Floats, heights: Floats, witnesses: Ints, wanted: Floats, stiffness: float
) -> tuple[Floats, Floats]:
    """Return what plates through their witnesses say of places, and how unsure a unit field is.

    Args:
        places: Of all samples (n, 2).
        heights: Theirs (n,).
        witnesses: Rows of the samples that speak for each place (m, k).
        wanted: The places (m, 2).
        stiffness: Of the plates.
    """
    parts = [
        _solved(places[rows] - at[:, None], heights[rows], stiffness)
        for rows, at in zip(
            np.array_split(witnesses, -(-len(wanted) // BLOCK)),
            np.array_split(wanted, -(-len(wanted) // BLOCK)),
            strict=True,
        )
    ]
    predicted, unsure = zip(*parts, strict=True)
    return np.concatenate(predicted), np.concatenate(unsure)


def _solved(offsets: Floats, heights: Floats, stiffness: float) -> tuple[Floats, Floats]:
    """Return prediction and standard error (m,) at 0 from witnesses at offsets (m, k, 2)."""
    m, k = heights.shape
    between = _increments(np.linalg.norm(offsets[:, :, None] - offsets[:, None], axis=-1))
    to_place = _increments(np.linalg.norm(offsets, axis=-1))
    plane = np.concatenate((np.ones((m, k, 1)), offsets), axis=2)
    system = np.zeros((m, k + 3, k + 3))
    system[:, :k, :k] = between + stiffness * np.eye(k)
    system[:, :k, k:], system[:, k:, :k] = plane, plane.transpose(0, 2, 1)
    sides = np.zeros((m, k + 3, 1))
    sides[:, :k, 0], sides[:, k, 0] = to_place, 1.0
    try:
        weights = np.linalg.solve(system, sides)[:, :k, 0]
    except np.linalg.LinAlgError:  # witnesses on one line carry no plane
        weights = (np.linalg.pinv(system) @ sides)[:, :k, 0]
    variance = np.einsum("mi,mij,mj->m", weights, between, weights)
    variance -= 2.0 * np.einsum("mi,mi->m", weights, to_place)
    return np.einsum("mi,mi->m", weights, heights), np.sqrt(np.maximum(variance, 0.0))


def _increments(distance: Floats) -> Floats:
    """Return r² log r, 0 at 0."""
    return distance**2 * np.log(np.maximum(distance, 1e-12))
