"""Robust statistics: scale from the median absolute deviation, weights of M-estimators.

Sources (docs/references.md): Hampel 1974 for the median absolute deviation, Beaton 1974 for the
biweight, Holland 1977 for reweighted least squares and the tuning constants, Huber 2009 for all.
"""

from collections.abc import Callable

import numpy as np

from rona_core.geometry.arrays import Floats

MAD_TO_SIGMA = 1.4826  # standard deviation of normal errors over their median absolute deviation
TUKEY_CUTOFF = 4.685  # standard deviations: 95 % efficient for normal errors (Holland 1977)


def mad_sigma(residuals: Floats, *, center: float = 0.0, floor: float = 0.0) -> float:
    """Return the standard deviation of normal errors with the same median absolute deviation.

    Half of the residuals may be arbitrarily wrong.

    Args:
        residuals: (n,) of any unit.
        center: The middle that deviations are taken from: 0 for residuals of a fit, the median
            for a sample.
        floor: The least value returned, in the unit of the residuals.
    """
    return max(MAD_TO_SIGMA * median(np.abs(residuals - center)), floor)


def median(values: Floats) -> float:
    """Return what ``np.median`` does for numbers (n,), n >= 1, in a third of its time."""
    half = len(values) // 2
    ordered = np.partition(values, (half - 1, half, len(values) - 1) if half else 0)
    if np.isnan(ordered[-1]):
        return float("nan")
    return float(ordered[half] if len(values) % 2 else (ordered[half - 1] + ordered[half]) / 2.0)


def tukey_weights(residuals: Floats, cutoff: Floats | float) -> Floats:
    """Return Tukey's biweight (1 - (r/c)^2)^2, and 0 from the cutoff on.

    Args:
        residuals: r, of any shape.
        cutoff: c > 0 in the unit of the residuals, usually ``TUKEY_CUTOFF`` standard deviations.
    """
    return tukey_weights_of_squares((residuals / cutoff) ** 2)


def tukey_weights_of_squares(squares: Floats) -> Floats:
    """Return Tukey's biweight of (r/c)^2, of any shape."""
    return np.maximum(1.0 - squares, 0.0) ** 2


def cauchy_weights(residuals: Floats, scale: Floats | float) -> Floats:
    """Return the weights 1 / (1 + (r/s)^2) of Cauchy's (Lorentz's) distribution.

    Unlike Tukey's they never vanish, so that a fit finds its way from a distant start.

    Args:
        residuals: r, of any shape.
        scale: s > 0 in the unit of the residuals: where the weight is one half.
    """
    return 1.0 / (1.0 + (residuals / scale) ** 2)


def reweighted_least_squares(
    design: Floats,
    target: Floats,
    weigh: Callable[[Floats], Floats],
    *,
    rounds: int,
    weights: Floats | None = None,
) -> Floats:
    """Fit a linear model by iteratively reweighted least squares (Holland 1977), and return (k,).

    Args:
        design: A (n, k) of target = A x + residuals.
        target: (n,).
        weigh: Takes residuals (n,) to weights (n,) of their squares.
        rounds: Number of weighted fits, at least 1.
        weights: (n,) of the first fit; None for all alike.
    """
    weights = np.ones(len(target)) if weights is None else weights
    solution = np.zeros(design.shape[1])
    for _ in range(rounds):
        root = np.sqrt(weights)
        solution = np.linalg.lstsq(design * root[:, None], target * root)[0]
        weights = weigh(target - design @ solution)
    return np.asarray(solution, dtype=np.float64)
