"""Smooth scalar fields on the unit sphere with closed gradients: bumps of the simulated skull.

A direction ``u`` is a unit vector (n, 3) from the centre of the head. Each field has ``value(u)``
(n,) in mm and ``gradient(u)`` (n, 3), the derivative by ``u`` as if it were free in space.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.sparse import coo_matrix
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats

HEAD_MM = 76.0  # radius that turns a length on the bone into an angle
FAR_SIDE = 0.5  # width along the axis of a bump, so that it does not appear on the far side too
REACH = 7.5  # standard deviations after which a smeared point counts as zero


class Field(Protocol):
    """A smooth scalar on the sphere."""

    def value(self, u: Floats) -> Floats:
        """Return the values (n,) in mm."""
        ...

    def gradient(self, u: Floats) -> Floats:
        """Return the gradients (n, 3) in mm."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Bumps:
    """A sum of Gaussians, each with its own axes and two widths."""

    axes: Floats  # (m, 3, 3): rows are the direction of the middle and the two tangents
    widths: Floats  # (m, 2) along the tangents, in radians
    heights_mm: Floats  # (m,)

    def _parts(self, u: Floats) -> tuple[Floats, Floats]:
        p = np.einsum("mij,nj->nmi", self.axes, u)
        p[..., 0] = p[..., 0] - 1.0
        scaled = p / np.column_stack((np.full(len(self.widths), FAR_SIDE), self.widths)) ** 2
        return self.heights_mm * np.exp(-0.5 * (p * scaled).sum(axis=2)), scaled

    def value(self, u: Floats) -> Floats:
        """Return the values (n,) in mm."""
        return self._parts(u)[0].sum(axis=1)

    def gradient(self, u: Floats) -> Floats:
        """Return the gradients (n, 3) in mm."""
        heights, scaled = self._parts(u)
        return -np.einsum("nm,nmi,mij->nj", heights, scaled, self.axes)


@dataclass(frozen=True, slots=True, eq=False)
class Waves:
    """A stationary random field: a sum of cosines with random wave vectors (Rahimi 2007)."""

    vectors: Floats  # (m, 3) in radians per unit of u
    phases_rad: Floats  # (m,)
    heights_mm: Floats  # (m,)

    @classmethod
    def draw(
        cls, rng: np.random.Generator, lengths_mm: Floats, sds_mm: Floats, n: int = 48
    ) -> "Waves":
        """Draw a field with Gaussian correlation exp(-d^2 / 2 L^2) for each length and SD."""
        vectors = rng.normal(size=(len(lengths_mm), n, 3)) * (HEAD_MM / lengths_mm)[:, None, None]
        heights = np.repeat(sds_mm * np.sqrt(2.0 / n), n)
        phases = rng.uniform(0.0, 2.0 * np.pi, len(heights))
        return cls(vectors.reshape(-1, 3), phases, heights)

    def value(self, u: Floats) -> Floats:
        """Return the values (n,) in mm."""
        return np.cos(u @ self.vectors.T + self.phases_rad) @ self.heights_mm

    def gradient(self, u: Floats) -> Floats:
        """Return the gradients (n, 3) in mm."""
        return -(np.sin(u @ self.vectors.T + self.phases_rad) * self.heights_mm) @ self.vectors


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Curves smeared by a Gaussian: a groove or a suture as a dense row of small bumps."""

    points: Floats  # (m, 3) unit directions along the curves
    weights_mm: Floats  # (m,)
    width: float  # standard deviation in radians

    def _pairs(self, u: Floats) -> Any:
        """Return the distances of all pairs (direction, point) within reach."""
        if not len(self.points):
            return coo_matrix((len(u), 0))
        reach = REACH * self.width
        near: Any = KDTree(u).sparse_distance_matrix(
            KDTree(self.points), reach, output_type="coo_matrix"
        )
        return near

    def _bells(self, pairs: Any) -> Floats:
        return self.weights_mm[pairs.col] * np.exp(-0.5 * (pairs.data / self.width) ** 2)

    def value(self, u: Floats) -> Floats:
        """Return the values (n,) in mm."""
        pairs = self._pairs(u)
        values: Any = np.bincount(pairs.row, self._bells(pairs), minlength=len(u))
        return values

    def gradient(self, u: Floats) -> Floats:
        """Return the gradients (n, 3) in mm."""
        pairs = self._pairs(u)
        pull = self._bells(pairs)[:, None] * (self.points[pairs.col] - u[pairs.row])
        columns = [np.bincount(pairs.row, column, minlength=len(u)) for column in pull.T]
        return np.stack(columns, axis=1) / self.width**2


@dataclass(frozen=True, slots=True)
class Egg:
    """The rounded box under all relief: a superellipsoid, flatter at the sides than at the top."""

    semi_axes_mm: tuple[float, float, float]
    flatness: float = 3.0  # exponent in the horizontal plane; 2 is an ellipse
    roundness: float = 1.9  # exponent between the horizontal plane and the vertical
    rounding: float = 0.12  # keeps the powers smooth where a coordinate is 0

    def _powers(self, u: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        t = u * (HEAD_MM / np.array(self.semi_axes_mm))
        exponents = np.array((self.flatness, self.flatness, self.roundness))
        squares = t**2 + self.rounding**2
        powers = squares ** (exponents / 2.0)
        slopes = exponents * powers / squares * t * (HEAD_MM / np.array(self.semi_axes_mm))
        level = powers[:, 0] + powers[:, 1]
        total = level ** (self.roundness / self.flatness) + powers[:, 2]
        return powers, slopes, level, total, HEAD_MM * total ** (-1.0 / self.roundness)

    def value(self, u: Floats) -> Floats:
        """Return the radius (n,) in mm."""
        return self._powers(u)[4]

    def gradient(self, u: Floats) -> Floats:
        """Return the gradients (n, 3) in mm."""
        _, slopes, level, total, radius = self._powers(u)
        ratio = self.roundness / self.flatness
        d_total = slopes.copy()
        d_total[:, :2] *= (ratio * level ** (ratio - 1.0))[:, None]
        return -(radius / (self.roundness * total))[:, None] * d_total
