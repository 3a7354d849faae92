"""Sphere fit to tracked positions: algebraic start, then geometric least squares.

Start: linear least squares (Coope 1993). Then the sum of squared
distances to the sphere is minimised, which has no bias towards small spheres on small caps.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, Vector3, as_points, readonly

MIN_THICKNESS = 0.005  # thickness over width of the points; a cap of 1 degree has this
MAX_SIGMA = 0.1  # of the radius: a centre less certain than this is a guess
TOLERANCE = 1e-15  # of the fit, all three of Levenberg-Marquardt


@dataclass(frozen=True, slots=True, eq=False)
class SphereFit:
    """A sphere, how far each point lies outside it, and how well its centre is known."""

    center: Vector3  # (3,), in the frame of the points
    radius_mm: float
    residuals_mm: Floats  # (n,) distance from the centre minus the radius
    rms_mm: float
    center_sigma_mm: float  # predicted 3D standard deviation of the centre; 0 for 4 points
    center_covariance: Floats  # (3, 3) mm^2, its trace is the square of that
    cap_deg: float  # largest angle, seen from the centre, between a point and the mean direction


def fit_sphere(points: ArrayLike) -> SphereFit:
    """Return the sphere with the least sum of squared distances to ``points``.

    Args:
        points: Positions in one frame, shape (n, 3) with n >= 4, in millimetres.

    Raises:
        InvalidInputError: wrong shape, fewer than 4 points, NaN or infinite values.
        DegenerateGeometryError: the points lie nearly in a plane, or the cap is so small for its
            noise that the centre would be a guess.
    """
    p = as_points(points, at_least=4)
    origin = p.mean(axis=0)
    spread = np.linalg.svd(p - origin, compute_uv=False)
    if spread[2] <= MIN_THICKNESS * spread[0]:
        width, thickness = spread[[0, 2]] / np.sqrt(len(p))
        raise DegenerateGeometryError(
            f"{len(p)} points are nearly flat ({thickness:.2g} mm thick, {width:.3g} mm wide): "
            "swing further, and in two directions"
        )
    scale = float(spread[0] / np.sqrt(len(p)))
    q = (p - origin) / scale  # centred and of size 1: well conditioned at any distance
    center, radius, solved = _refine(q, *_algebraic(q))
    offsets = q - center
    distances = np.linalg.norm(offsets, axis=1)
    residuals = distances - radius
    covariance = _center_covariance(offsets / distances[:, None], residuals)
    sigma = float(np.sqrt(np.trace(covariance)))
    if not solved or sigma > MAX_SIGMA * radius:
        raise DegenerateGeometryError(
            f"the cap is too small for its noise: centre uncertain by {sigma * scale:.2g} mm at a "
            f"radius of {radius * scale:.3g} mm; swing further"
        )
    rms_mm = float(np.sqrt((residuals**2).mean()) * scale)
    return SphereFit(
        center=readonly(origin + scale * center),
        radius_mm=float(radius * scale),
        residuals_mm=readonly(residuals * scale),
        rms_mm=rms_mm,
        center_sigma_mm=sigma * scale,
        center_covariance=readonly(covariance * scale**2),
        cap_deg=cap_half_angle_deg(offsets / distances[:, None]),
    )


def cap_half_angle_deg(directions: Floats) -> float:
    """Return the largest angle in degrees between unit ``directions`` (n, 3) and their mean."""
    mean = directions.mean(axis=0)
    across = np.linalg.norm(np.cross(directions, mean), axis=1)
    return float(np.rad2deg(np.arctan2(across, directions @ mean).max()))


def _algebraic(q: Floats) -> tuple[Floats, float]:
    """Return centre and radius from 2 q.c + (r^2 - |c|^2) = |q|^2, linear in the unknowns."""
    design = np.column_stack((2.0 * q, np.ones(len(q))))
    x = np.linalg.lstsq(design, (q**2).sum(axis=1))[0]
    return x[:3], float(np.sqrt(x[3] + x[:3] @ x[:3]))


def _refine(q: Floats, center: Floats, radius: float) -> tuple[Floats, float, bool]:
    """Return the geometric fit (Levenberg-Marquardt), and whether it converged."""
    jacobian: Any = _jacobian  # the stubs know strings only
    found: Any = least_squares(
        _residuals,
        np.append(center, radius),
        jacobian,
        method="lm",
        ftol=TOLERANCE,
        xtol=TOLERANCE,
        gtol=TOLERANCE,
        args=(q,),
    )
    return found.x[:3], float(found.x[3]), bool(found.status > 0)


def _residuals(x: Floats, q: Floats) -> Floats:
    """Return the distances (n,) of points from the sphere of centre and radius x (4,)."""
    return np.linalg.norm(q - x[:3], axis=1) - x[3]


def _jacobian(x: Floats, q: Floats) -> Floats:
    """Return the derivatives (n, 4) of the distances by centre and radius."""
    offsets = q - x[:3]
    distances = np.maximum(np.linalg.norm(offsets, axis=1), 1e-300)
    return np.column_stack((-offsets / distances[:, None], -np.ones(len(q))))


def _center_covariance(directions: Floats, residuals: Floats) -> Floats:
    """Return the covariance (3, 3) of the centre, from the scatter left over."""
    freedom = len(residuals) - 4
    if freedom <= 0:
        return np.zeros((3, 3))
    jacobian = np.column_stack((directions, np.ones(len(directions))))
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * (residuals @ residuals) / freedom
    return covariance[:3, :3].copy()
