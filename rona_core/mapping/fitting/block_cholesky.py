"""Cholesky factor of a symmetric block-tridiagonal matrix, and what follows from it.

A field on a grid whose cells depend on near ones alone has such a precision: its rows, a few at a
time, are the blocks. Cost grows with the number of blocks and the cube of their size.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from rona_core.geometry.arrays import Floats

ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class BlockTridiagonal:
    """A symmetric matrix of m by m blocks, each b by b; all others are zero."""

    diagonal: Floats  # (m, b, b)
    below: Floats  # (m - 1, b, b) block k + 1, k

    def __add__(self, other: "BlockTridiagonal") -> "BlockTridiagonal":
        return BlockTridiagonal(self.diagonal + other.diagonal, self.below + other.below)

    def __mul__(self, factor: float) -> "BlockTridiagonal":
        return BlockTridiagonal(factor * self.diagonal, factor * self.below)

    def held(self) -> "BlockTridiagonal":
        """Return it with a diagonal that is so much larger as rounding asks for."""
        ridge = ROUNDING * max(float(np.abs(self.diagonal).max()), 1.0)
        return BlockTridiagonal(self.diagonal + ridge * np.eye(self.diagonal.shape[1]), self.below)

    def energy(self, values: Floats) -> float:
        """Return the quadratic form at values (m b,)."""
        rows = values.reshape(len(self.diagonal), -1)
        whole = np.einsum("ki,kij,kj->", rows, self.diagonal, rows, optimize=True)
        whole += 2.0 * np.einsum("ki,kij,kj->", rows[1:], self.below, rows[:-1], optimize=True)
        return float(whole)

    def cholesky(self) -> "BlockCholesky":
        """Return the factor.

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        lower, below = np.zeros_like(self.diagonal), np.zeros_like(self.below)
        rest = self.diagonal[0]
        for k in range(len(lower)):
            lower[k] = np.linalg.cholesky(rest)
            if k < len(below):
                below[k] = _solved(lower[k], self.below[k].T).T
                rest = self.diagonal[k + 1] - below[k] @ below[k].T
        return BlockCholesky(lower, below)


@dataclass(frozen=True, slots=True, eq=False)
class BlockCholesky:
    """Lower triangular factor L of a block-tridiagonal matrix Q = L Lᵀ."""

    lower: Floats  # (m, b, b)
    below: Floats  # (m - 1, b, b)

    def log_determinant(self) -> float:
        """Return log det Q."""
        return float(2.0 * np.log(np.diagonal(self.lower, axis1=1, axis2=2)).sum())

    def solve(self, right: Floats) -> Floats:
        """Return Q⁻¹ times columns (m b,) or (m b, n)."""
        parts = right.reshape(len(self.lower), self.lower.shape[1], -1).copy()
        for k in range(len(parts)):
            if k:
                parts[k] -= self.below[k - 1] @ parts[k - 1]
            parts[k] = _solved(self.lower[k], parts[k])
        return self._backward(parts).reshape(right.shape)

    def spread(self, white: Floats) -> Floats:
        """Return L⁻ᵀ times columns (m b, n): of white noise, draws with the covariance Q⁻¹."""
        parts = white.reshape(len(self.lower), self.lower.shape[1], -1).copy()
        return self._backward(parts).reshape(white.shape)

    def variances(self) -> Floats:
        """Return the diagonal (m b,) of Q⁻¹ (Takahashi's recursion, block by block)."""
        found = np.zeros(self.lower.shape[:2])
        inverse = np.zeros(self.lower.shape[1:])
        unit = np.eye(self.lower.shape[1])
        for k in range(len(self.lower) - 1, -1, -1):
            root = _solved(self.lower[k], unit)
            here = root.T @ root
            if k < len(self.below):
                reach = root.T @ self.below[k].T
                here = here + reach @ inverse @ reach.T
            inverse, found[k] = here, np.diagonal(here)
        return found.ravel()

    def _backward(self, parts: Floats) -> Floats:
        for k in range(len(parts) - 1, -1, -1):
            if k < len(self.below):
                parts[k] -= self.below[k].T @ parts[k + 1]
            parts[k] = _solved(self.lower[k], parts[k], transposed=True)
        return parts


def _solved(lower: Floats, right: Floats, *, transposed: bool = False) -> Floats:
    found = solve_triangular(lower, right, lower=True, trans=int(transposed), check_finite=False)
    return np.asarray(found, dtype=np.float64)
