"""Least-squares fits: rigid motion between point sets, plane and line.

Each refuses points that do not determine its answer, with the number that says why.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3, as_points, readonly
from rona_core.geometry.pose import Pose

MIN_WIDTH = 0.01  # width over length of a point set; thinner sets leave a turn undetermined
MAX_THICKNESS = 0.9  # thickness over width of a plane, or width over length of a line


@dataclass(frozen=True, slots=True, eq=False)
class RigidFit:
    """A rigid motion between two point sets and what it leaves over."""

    T_b_a: Pose
    rms_mm: float
    residuals_mm: Floats  # (n,) distance of each mapped point from its partner


@dataclass(frozen=True, slots=True, eq=False)
class PlaneFit:
    """A plane through the centroid of some points, in their frame."""

    point: Vector3  # (3,) the centroid
    normal: Vector3  # (3,) unit; its component of largest size is positive
    rms_mm: float  # of the distances to the plane


@dataclass(frozen=True, slots=True, eq=False)
class LineFit:
    """A line through the centroid of some points, in their frame."""

    point: Vector3  # (3,) the centroid
    direction: Vector3  # (3,) unit; from the first points towards the last
    rms_mm: float  # of the distances to the line
    length_mm: float  # extent of the points along the line


def register_points(points_a: ArrayLike, points_b: ArrayLike) -> RigidFit:
    """Register two point sets rigidly: ``T_b_a`` with the least sum of squared residuals.

    Source: Kabsch 1976; reflection test after Umeyama 1991.

    Args:
        points_a: Points in frame ``a``, shape (n, 3) with n >= 3, in mm.
        points_b: The same points in frame ``b``, in the same order.

    Raises:
        InvalidInputError: wrong shape, different numbers of points, values not finite.
        DegenerateGeometryError: the points lie on one line, or mirror each other.
    """
    a = as_points(points_a, at_least=3, name="points_a")
    b = as_points(points_b, at_least=3, name="points_b")
    if len(a) != len(b):
        raise InvalidInputError(f"points must come in pairs: {len(a)} in a, {len(b)} in b")
    mean_a, mean_b = a.mean(axis=0), b.mean(axis=0)
    u, s, vt = np.linalg.svd((b - mean_b).T @ (a - mean_a))
    handed = 1.0 if np.linalg.det(u @ vt) > 0 else -1.0
    if s[1] + handed * s[2] <= MIN_WIDTH**2 * s[0]:
        raise DegenerateGeometryError(
            f"{len(a)} point pairs do not determine a rotation: they lie on one line or are "
            f"mirrored (relative strength {(s[1] + handed * s[2]) / max(s[0], 1e-300):.2g})"
        )
    rotation = (u * (1.0, 1.0, handed)) @ vt
    T_b_a = Pose(rotation, mean_b - rotation @ mean_a)
    residuals = np.linalg.norm(T_b_a @ a - b, axis=1)
    return RigidFit(T_b_a, float(np.sqrt((residuals**2).mean())), readonly(residuals))


def fit_plane(points: ArrayLike) -> PlaneFit:
    """Return the plane with the least sum of squared distances to ``points`` (n, 3), n >= 3.

    Raises:
        InvalidInputError: wrong shape or values not finite.
        DegenerateGeometryError: the points lie on one line, or are as thick as they are wide.
    """
    p = as_points(points, at_least=3)
    center = p.mean(axis=0)
    _, s, axes = np.linalg.svd(p - center, full_matrices=False)
    if s[1] <= MIN_WIDTH * s[0] or s[2] > MAX_THICKNESS * s[1]:
        spread = s / np.sqrt(len(p))
        raise DegenerateGeometryError(
            f"{len(p)} points do not determine a plane: they spread "
            f"{spread[0]:.3g} x {spread[1]:.3g} x {spread[2]:.3g} mm"
        )
    normal = axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))])
    return PlaneFit(readonly(center), readonly(normal), float(s[2] / np.sqrt(len(p))))


def fit_line_direction(points: ArrayLike) -> LineFit:
    """Return the line with the least sum of squared distances to ``points`` (n, 3), n >= 2.

    Raises:
        InvalidInputError: wrong shape or values not finite.
        DegenerateGeometryError: the points coincide, or are as wide as they are long.
    """
    p = as_points(points, at_least=2)
    center = p.mean(axis=0)
    _, s, axes = np.linalg.svd(p - center, full_matrices=False)
    if s[0] <= 0.0 or s[1] > MAX_THICKNESS * s[0]:
        spread = s / np.sqrt(len(p))
        raise DegenerateGeometryError(
            f"{len(p)} points do not determine a direction: they spread {spread[0]:.3g} mm "
            f"along and {spread[1]:.3g} mm across"
        )
    along = (p - center) @ axes[0]
    order = np.arange(len(p)) - (len(p) - 1) / 2
    direction = -axes[0] if order @ along < 0 else axes[0].copy()
    across = np.sqrt(max((s[1:] ** 2).sum(), 0.0) / len(p))
    return LineFit(readonly(center), readonly(direction), float(across), float(np.ptp(along)))
