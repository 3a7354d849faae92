"""Cholesky factor of a symmetric banded matrix, and what follows from it.

A field on a grid whose cells depend on near ones alone has such a precision. Cost grows with the
number of rows and the square of the width of the band.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import blas, lapack, solve_triangular

from rona_core.geometry.arrays import Floats

ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class FewBands:
    """A symmetric matrix (n, n) of which few diagonals are not zero, by those of its lower half."""

    depths: tuple[int, ...]  # of the diagonals, the lowest last
    entries: Floats  # (d, n): row i holds the entries (j + depths[i], j)

    def filled(self) -> "BandedMatrix":
        """Return it with all bands down to the lowest."""
        bands = np.zeros((self.depths[-1] + 1, self.entries.shape[1]), order="F")
        bands[list(self.depths)] = self.entries
        return BandedMatrix(bands)


@dataclass(frozen=True, slots=True, eq=False)
class BandedMatrix:
    """A symmetric matrix (n, n) that is zero beyond k places from its diagonal; n = m k."""

    bands: Floats  # (k + 1, n) in the order of Fortran: row d holds the entries (j + d, j)

    def plus(self, factor: float, other: FewBands, out: Floats) -> "BandedMatrix":
        """Return the sum of it and ``factor`` times another, in bands ``out``: they may be its."""
        if out is not self.bands:
            np.copyto(out, self.bands)
        flat, width = out.ravel(order="K"), len(out)
        for depth, row in zip(other.depths, other.entries, strict=True):
            blas.daxpy(row, flat, a=factor, offy=depth, incy=width)  # in place
        return BandedMatrix(out)

    def regularize(self) -> None:
        """Make the diagonal so much larger as rounding asks for."""
        largest = max(float(self.bands.max()), -float(self.bands.min()), 1.0)
        self.bands[0] += ROUNDING * largest

    def energy(self, values: Floats) -> float:
        """Return the quadratic form at values (n,)."""
        width = len(self.bands) - 1
        return float(values @ blas.dsbmv(width, 1.0, self.bands, values, lower=1))

    def cholesky(self, *, overwrite: bool = False) -> "BandedCholesky":
        """Return the factor; with ``overwrite`` in the place of the matrix, which is lost.

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        bands, failed = lapack.dpbtrf(self.bands, lower=1, overwrite_ab=overwrite)
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
        size = len(self.bands) - 1
        count = self.bands.shape[1] // size
        row, column = np.indices((size, size))
        found = np.zeros((count, size))
        inverse, unit = np.zeros((size, size)), np.eye(size)
        for k in reversed(range(count)):
            columns = column + size * k
            on = self.bands[np.maximum(row - column, 0), columns] * (row >= column)
            root = np.asarray(solve_triangular(on, unit, lower=True, check_finite=False))
            here = root.T @ root
            if k + 1 < count:
                below = self.bands[size + np.minimum(row - column, 0), columns] * (row <= column)
                reach = root.T @ below.T
                here = here + reach @ inverse @ reach.T
            inverse, found[k] = here, np.diagonal(here)
        return found.ravel()
