"""Cholesky factor of a symmetric banded matrix, and what follows from it.

A field on a grid whose cells depend on near ones alone has such a precision. Cost grows with the
number of rows and the square of the width of the band.
"""

# pyright: reportAttributeAccessIssue=false
# (the routines of BLAS and LAPACK come from compiled modules without stubs)

from dataclasses import dataclass

import numpy as np
from scipy.linalg import blas, lapack, solve_triangular

from rona_core.geometry.arrays import Floats

ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class BandedMatrix:
    """A symmetric matrix (n, n) that is zero beyond k places from its diagonal; n = m k."""

    bands: Floats  # (k + 1, n) in the order of Fortran: row d holds the entries (j + d, j)

    def __add__(self, other: "BandedMatrix") -> "BandedMatrix":
        return BandedMatrix(self.bands + other.bands)

    def __mul__(self, factor: float) -> "BandedMatrix":
        return BandedMatrix(factor * self.bands)

    def held(self) -> "BandedMatrix":
        """Return it with a diagonal that is so much larger as rounding asks for."""
        bands = self.bands.copy(order="F")
        bands[0] += ROUNDING * max(float(np.abs(self.bands).max()), 1.0)
        return BandedMatrix(bands)

    def energy(self, values: Floats) -> float:
        """Return the quadratic form at values (n,)."""
        width = len(self.bands) - 1
        return float(values @ blas.dsbmv(width, 1.0, self.bands, values, lower=1))

    def cholesky(self) -> "BandedCholesky":
        """Return the factor.

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        bands, failed = lapack.dpbtrf(self.bands, lower=1)
        if failed:
            raise np.linalg.LinAlgError(f"not positive definite in row {failed}")
        return BandedCholesky(bands)


@dataclass(frozen=True, slots=True, eq=False)
class BandedCholesky:
    """Lower triangular factor L of a banded matrix Q = L Lᵀ."""

    bands: Floats  # (k + 1, n), as those of the matrix

    def log_determinant(self) -> float:
        """Return log det Q."""
        return float(2.0 * np.log(self.bands[0]).sum())

    def solve(self, right: Floats) -> Floats:
        """Return Q⁻¹ times columns (n,) or (n, c)."""
        return np.asarray(lapack.dpbtrs(self.bands, right, lower=1)[0], dtype=np.float64)

    def spread(self, white: Floats) -> Floats:
        """Return L⁻ᵀ times columns (n, c): of white noise, draws with the covariance Q⁻¹."""
        found = lapack.dtbtrs(self.bands, white, uplo="L", trans="T")[0]
        return np.asarray(found, dtype=np.float64)

    def variances(self) -> Floats:
        """Return the diagonal (n,) of Q⁻¹ (Takahashi's recursion, in blocks of k rows)."""
        lower, below = self._blocks()
        found = np.zeros(lower.shape[:2])
        inverse, unit = np.zeros(lower.shape[1:]), np.eye(lower.shape[1])
        for k in range(len(lower) - 1, -1, -1):
            root = solve_triangular(lower[k], unit, lower=True, check_finite=False)
            here = root.T @ root
            if k < len(below):
                reach = root.T @ below[k].T
                here = here + reach @ inverse @ reach.T
            inverse, found[k] = here, np.diagonal(here)
        return found.ravel()

    def _blocks(self) -> tuple[Floats, Floats]:
        """Return the blocks (m, k, k) of L on its diagonal and those (m - 1, k, k) below."""
        size = len(self.bands) - 1
        row, column = np.indices((size, size))
        columns = column + size * np.arange(self.bands.shape[1] // size)[:, None, None]
        on = self.bands[np.maximum(row - column, 0), columns]
        off = self.bands[size + np.minimum(row - column, 0), columns[:-1]]
        return on * (row >= column), off * (row <= column)
