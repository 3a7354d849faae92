"""Smooth fields and landmarks on the unit sphere: bumps, waves and grooves of a simulated skull.

A direction ``u`` is a unit vector (n, 3) from the centre of the head. Landmarks are named by
millimetres behind and above the ear canal, in the frame ``skull``: origin midway between the ear
canals, x right, y forward, z up.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebvander
from scipy.interpolate import CubicSpline
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, Vector3

HEAD_MM = 76.0  # radius that turns a length on the bone into an angle
FAR_SIDE = 0.5  # width along the axis of a bump, so that it does not appear on the far side too
REACH = 7.5  # standard deviations after which a smeared point counts as zero
CENTER_SKULL = (0.0, -6.0, 48.0)  # from where the head is seen as a function of direction
BISECTIONS = 40
BLOCK = 2048  # directions at once: of an atlas the waves are 100 MB together
CHEBYSHEV_NODES = (40, 1.6)  # across a chart, and more for each radian from its middle

Place = tuple[float, float]  # mm behind, mm above the ear canal


class Field(Protocol):
    """A smooth scalar on the sphere."""

    def value(self, u: Floats) -> Floats:
        """Return the values (n,) in mm."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Bumps:
    """A sum of Gaussians, each with its own axes and two widths."""

    axes: Floats  # (m, 3, 3): rows are the direction of the middle and the two tangents
    widths: Floats  # (m, 2) along the tangents, in radians
    heights_mm: Floats  # (m,)

    def value(self, u: Floats) -> Floats:
        """Return the values (n,) in mm."""
        square = ((u @ self.axes[:, 0].T - 1.0) / FAR_SIDE) ** 2
        for k in range(2):
            square += (u @ self.axes[:, k + 1].T / self.widths[:, k]) ** 2
        return np.exp(-0.5 * square) @ self.heights_mm


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
        values = np.zeros(len(u))
        for start in range(0, len(u), BLOCK):
            waves = u[start : start + BLOCK] @ self.vectors.T
            waves += self.phases_rad
            values[start : start + BLOCK] = np.cos(waves, out=waves) @ self.heights_mm
        return values

    def chart_value(self, axes: Floats, slopes: Floats) -> Floats:
        """Return the values (n n,) in mm at ``chart_directions``, by Chebyshev interpolation.

        Waves are smooth: what the polynomials leave out is less than 1e-11 mm.
        """
        least, more = CHEBYSHEV_NODES
        steepest = float(np.linalg.norm(self.vectors, axis=1).max())
        nodes = chebpts1(least + int(more * steepest * slopes[-1]))
        at_nodes = self.value(chart_directions(axes, slopes[-1] * nodes)).reshape(2 * nodes.shape)
        known, wanted = (chebvander(x, len(nodes) - 1) for x in (nodes, slopes / slopes[-1]))
        between = wanted @ np.linalg.inv(known)
        return (between @ at_nodes @ between.T).ravel()


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Curves smeared by a Gaussian: a groove or a suture as a dense row of small bumps."""

    points: Floats  # (m, 3) unit directions along the curves
    weights_mm: Floats  # (m,)
    width: float  # standard deviation in radians

    def value(self, u: Floats) -> Floats:
        """Return the values (n,) in mm."""
        # distances of all pairs (direction, point) within reach
        tree = KDTree(u, compact_nodes=False, balanced_tree=False)  # asked once: quick to build
        pairs: Any = tree.sparse_distance_matrix(
            KDTree(self.points), REACH * self.width, output_type="coo_matrix"
        )
        bells = self.weights_mm[pairs.col] * np.exp(-0.5 * (pairs.data / self.width) ** 2)
        values: Any = np.bincount(pairs.row, bells, minlength=len(u))
        return values


@dataclass(frozen=True, slots=True)
class Egg:
    """The rounded box under all relief: a superellipsoid, flatter at the sides than at the top."""

    semi_axes_mm: tuple[float, float, float]
    flatness: float = 3.0  # exponent in the horizontal plane; 2 is an ellipse
    roundness: float = 1.9  # exponent between the horizontal plane and the vertical
    rounding: float = 0.12  # keeps the powers smooth where a coordinate is 0

    def value(self, u: Floats) -> Floats:
        """Return the radius (n,) in mm."""
        t = u * (HEAD_MM / np.array(self.semi_axes_mm))
        exponents = np.array((self.flatness, self.flatness, self.roundness))
        squares = t**2 + self.rounding**2
        powers = squares ** (exponents / 2.0)
        level = powers[:, 0] + powers[:, 1]
        total = level ** (self.roundness / self.flatness) + powers[:, 2]
        return HEAD_MM * total ** (-1.0 / self.roundness)


def direction_of(egg: Egg, place: Place, side: int) -> Vector3:
    """Return the unit direction (3,) from the centre to a place on the egg.

    Args:
        egg: The egg of the head.
        place: Millimetres behind and above the ear canal.
        side: +1 right, -1 left, 0 in the midline.
    """
    behind, above = place
    low, high = 0.0, HEAD_MM
    center = np.array(CENTER_SKULL)
    if side:
        for _ in range(BISECTIONS):
            x = 0.5 * (low + high)
            v = np.array((x, -behind, above)) - center
            distance = np.linalg.norm(v)
            inside = distance < egg.value((v / distance)[None])[0]
            low, high = (x, high) if inside else (low, x)
    v = np.array((side * low, -behind, above)) - center
    return v / np.linalg.norm(v)


def chart_directions(axes: Floats, slopes: Floats) -> Floats:
    """Return the unit directions (n n, 3) with each pair of slopes (n,) about axes (3, 3)."""
    a, b = (grid.ravel() for grid in np.meshgrid(slopes, slopes, indexing="ij"))
    w = np.stack((np.ones_like(a), a, b), axis=1) @ axes
    return w / np.linalg.norm(w, axis=1)[:, None]


def tangents(direction: Vector3) -> Floats:
    """Return axes (3, 3): the direction, backward along the head, and the rest; rows."""
    backward = np.array((0.0, -1.0, 0.0))
    if abs(direction @ backward) > 0.9:
        backward = np.array((1.0, 0.0, 0.0))
    e1 = backward - (backward @ direction) * direction
    e1 = e1 / np.linalg.norm(e1)
    return np.stack((direction, e1, np.cross(direction, e1)))


def trace_curve(waypoints: Floats, step: float, wiggle: Floats | None = None) -> Floats:
    """Return unit directions (m, 3), ``step`` radians apart, on a smooth curve.

    Args:
        waypoints: Unit directions (k, 3) that the curve passes through, k >= 2.
        step: Angle between neighbours.
        wiggle: Amplitudes, wave numbers (per radian) and phases (3, j) of a sideways zigzag.
    """
    chords = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    knots = np.concatenate(([0.0], np.cumsum(chords)))
    s = np.linspace(0.0, knots[-1], max(2, int(np.ceil(knots[-1] / step)) + 1))
    spline = CubicSpline(knots, waypoints)
    points = spline(s)
    if wiggle is not None:
        sideways = np.cross(points, spline(s, 1))
        sideways = sideways / np.linalg.norm(sideways, axis=1, keepdims=True)
        amplitudes, numbers, phases = wiggle
        points = points + (np.sin(np.outer(s, numbers) + phases) @ amplitudes)[:, None] * sideways
    return points / np.linalg.norm(points, axis=1, keepdims=True)
