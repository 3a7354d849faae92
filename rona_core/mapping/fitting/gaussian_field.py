"""Draws of Gaussian fields over a grid, and of single numbers that are stratified."""

import numpy as np
from numpy.random import Generator
from scipy.special import ndtri

from rona_core.geometry.arrays import Floats

LEAST_SHARE = 1e-9  # of a range, so that none is infinite


def field_root(at_mm: Floats, reach_mm: float) -> Floats:
    """Return a root (n, n) of the covariance of places (n,) along one axis, of variance 1.

    White noise (nu, nv) between the roots of both axes is a field over their grid.

    Args:
        at_mm: Places along the axis.
        reach_mm: Standard deviation of the Gaussian by which two of them still vary alike.
    """
    if reach_mm <= 0.0:
        return np.eye(len(at_mm))
    apart = (at_mm[:, None] - at_mm) / reach_mm
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart**2))
    return vectors * np.sqrt(np.maximum(values, 0.0))  # far from regular: no Cholesky


def stratified_normals(count: int, generator: Generator) -> Floats:
    """Return standard normal numbers (count,), one of each of as many equally likely ranges.

    So a few of them have the spread of many (Latin hypercube, McKay 1979); they depend on each
    other.
    """
    within = generator.uniform(LEAST_SHARE, 1.0, count)
    return ndtri((generator.permutation(count) + within) / count)
