"""Robust estimate of the marker error from the residuals, and detection of gross errors."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from rona_core.geometry.arrays import Bools, Floats

DOF = 6  # of one pose
FLOOR_MM = 1e-6  # of the marker error
CEILING_MM = 1e3
MEDIAN = float(chdtri(DOF, 0.5))  # of the squared distance of a good pose
GROSS = float(chdtri(DOF, 1e-3))  # one good pose in a thousand lies beyond
BISECTIONS = 45


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Squared distances of the poses as a function of the marker error sigma, 1D per component.

    With marker covariance s^2 M = s^2 L L', robot covariance C and L^-1 C L'^-1 = U diag(d) U',
    e' (s^2 M + C)^-1 e = sum z^2 / (s^2 + d) with z = U' L^-1 e.
    """

    squares: Floats  # (n, 6) z^2
    robot: Floats  # (n, 6) d

    def distances(self, sigma_mm: float) -> Floats:
        """Return the squared distances (n,) for a marker error of ``sigma_mm``."""
        return (self.squares / (sigma_mm**2 + self.robot)).sum(axis=1)


def spectrum(residuals: Floats, unit_covariances: Floats, robot_covariances: Floats) -> Spectrum:
    """Return the spectrum of residuals (n, 6) with covariances (n, 6, 6) of marker and robot."""
    inverse = np.linalg.inv(np.linalg.cholesky(unit_covariances))
    whitened = inverse @ robot_covariances @ np.swapaxes(inverse, 1, 2)
    values, vectors = np.linalg.eigh((whitened + np.swapaxes(whitened, 1, 2)) / 2.0)
    z = np.einsum("nji,njk,nk->ni", vectors, inverse, residuals)
    return Spectrum(z**2, np.maximum(values, 0.0))


def sigma_by_median(spectrum: Spectrum) -> float:
    """Return the marker error that gives the median pose the distance it should have."""

    def excess(sigma_mm: float) -> float:
        return float(np.median(spectrum.distances(sigma_mm))) - MEDIAN

    return _root(excess)


def sigma_by_mean(spectrum: Spectrum, used: Bools, unknowns: int) -> float:
    """Return the marker error with which the poses used leave what their number allows."""
    degrees = DOF * int(used.sum()) - unknowns
    squares, robot = spectrum.squares[used], spectrum.robot[used]

    def excess(sigma_mm: float) -> float:
        return float((squares / (sigma_mm**2 + robot)).sum()) - degrees

    return _root(excess)


def _root(excess: Callable[[float], float]) -> float:
    """Return where a decreasing function of sigma crosses zero, within floor and ceiling."""
    low, high = np.log(FLOOR_MM), np.log(CEILING_MM)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2.0
        if excess(float(np.exp(middle))) > 0.0:
            low = middle
        else:
            high = middle
    return float(np.exp(low)) if low > np.log(FLOOR_MM) else FLOOR_MM
