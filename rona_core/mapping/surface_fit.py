"""Smooth scattered heights by a thin plate whose stiffness the samples choose themselves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.spatial import KDTree

from rona_core.arrays import Floats, Ints, Scalar

STIFFNESSES = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0)  # smoothing of the plate that is tried
FOLDS = 5
MOST_FOR_CHOICE = 500  # samples that take part in choosing the stiffness
GLOBAL_LIMIT = 2500  # beyond this many samples, only the nearest ones hold the plate
NEIGHBOURS = 80
SIGMA_NEIGHBOURS = 24  # samples that share in a standard error
LEAST_FREEDOM = 0.1
BLOCK = 500  # places at a time


@dataclass(frozen=True, slots=True, eq=False)
class PlateFit:
    """A fitted plate: heights at any place, and the scatter of the samples about it."""

    plate: RBFInterpolator
    places_mm: Floats  # (n, 2)
    residuals_mm: Floats  # (n,)
    relative_variance: Floats  # (n,)
    stiffness: float

    def heights(self, places_mm: Floats) -> Floats:
        """Return the heights (m,) at places (m, 2)."""
        return np.asarray(self.plate(places_mm), dtype=np.float64)

    def sigma_mm(self, places_mm: Floats) -> Floats:
        """Return the standard error of the heights (m,).

        A height is a weighted sum of samples: the weights come from a plate through the nearest
        samples alone, the noise of the samples from their residuals nearby.
        """
        near, weights = self._weights(self.places_mm)
        own = np.where(near == np.arange(len(near))[:, None], weights, 0.0).sum(axis=1)
        freedom = np.clip(1.0 - own, LEAST_FREEDOM, 1.0)  # the fit has eaten the rest
        noise = self.residuals_mm**2 / freedom / self.relative_variance  # of a perfect sample
        overall = float(noise.mean())
        near, weights = self._weights(places_mm)
        share = np.abs(weights)
        # a robust mixture: a few residuals alone are too few to tell a variance
        local = (share * noise[near]).sum(axis=1) / share.sum(axis=1)
        variance = (0.5 * (local + overall))[:, None] * self.relative_variance[near]
        return np.sqrt((variance * weights**2).sum(axis=1))

    def _weights(self, places_mm: Floats) -> tuple[Ints, Floats]:
        """Return the nearest samples (m, k) and the weight of each in the height at m places."""
        k = min(SIGMA_NEIGHBOURS, len(self.places_mm))
        near = np.asarray(KDTree(self.places_mm).query(places_mm, k=k)[1], dtype=np.int64)
        parts = [
            _plate_weights(self.places_mm[rows], self.stiffness * self.relative_variance[rows], at)
            for rows, at in zip(_blocks(near), _blocks(places_mm), strict=True)
        ]
        return near, np.concatenate(parts)


def _blocks(rows: NDArray[Scalar]) -> list[NDArray[Scalar]]:
    return [rows[i : i + BLOCK] for i in range(0, len(rows), BLOCK)]


def _plate_weights(samples: Floats, smoothing: Floats, at: Floats) -> Floats:
    """Return the weights (m, k) of samples (m, k, 2) in the height of a plate at places (m, 2)."""
    m, k, _ = samples.shape
    offset = samples - at[:, None, :]
    system = np.zeros((m, k + 3, k + 3))
    system[:, :k, :k] = _kernel(np.linalg.norm(offset[:, :, None] - offset[:, None], axis=-1))
    system[:, np.arange(k), np.arange(k)] += smoothing
    plane = np.concatenate((np.ones((m, k, 1)), offset), axis=2)
    system[:, :k, k:] = plane
    system[:, k:, :k] = np.swapaxes(plane, 1, 2)
    right = np.zeros((m, k + 3))
    right[:, :k] = _kernel(np.linalg.norm(offset, axis=-1))
    right[:, k] = 1.0
    return np.asarray(np.linalg.solve(system, right[..., None])[:, :k, 0], dtype=np.float64)


def _kernel(distance_mm: Floats) -> Floats:
    """Return r^2 log r, the kernel of the thin plate."""
    log = np.log(np.maximum(distance_mm, 1e-300))
    return np.asarray(distance_mm**2 * log, dtype=np.float64)


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
    chosen = _choose(places_mm, heights_mm, weights) if stiffness is None else stiffness
    plate = _plate(places_mm, heights_mm, chosen * weights)
    left = heights_mm - np.asarray(plate(places_mm))
    return PlateFit(plate, places_mm, left, weights, float(chosen))


def _plate(places: Floats, heights: Floats, smoothing: Floats) -> RBFInterpolator:
    neighbours = NEIGHBOURS if len(heights) > GLOBAL_LIMIT else None
    return RBFInterpolator(
        places,
        heights,
        neighbors=neighbours,
        smoothing=smoothing,  # pyright: ignore[reportArgumentType]  # one for each sample
        kernel="thin_plate_spline",
    )


def _choose(places: Floats, heights: Floats, weights: Floats) -> float:
    """Return the stiffness whose plate predicts left-out samples best."""
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
