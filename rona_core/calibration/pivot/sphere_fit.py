"""Sphere fit to tracked positions: algebraic start, then geometric least squares.

Start: linear least squares (Coope, J. Optim. Theory Appl. 76 (1993) 381). Then the sum of squared
distances to the sphere is minimised, which has no bias towards small spheres on small caps.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, Vector3, as_points, readonly

MIN_THICKNESS = 0.005  # thickness over width of the points; a cap of 1 degree has this
MAX_SIGMA = 0.1  # of the radius: a centre less certain than this is a guess
MAX_STEPS = 200
STEP_TOLERANCE = 1e-14  # of the size of the point set


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
    """Return the geometric fit by damped Gauss-Newton, and whether it settled."""
    x: Floats = np.append(center, radius)
    damping = 1e-6
    residuals, jacobian = _residuals(q, x)
    for _ in range(MAX_STEPS):
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ residuals
        damped = normal + damping * np.diag(np.diag(normal))
        step = np.asarray(-np.linalg.solve(damped, gradient), dtype=np.float64)
        if np.abs(step).max() <= STEP_TOLERANCE * np.abs(x).max():
            return x[:3], float(x[3]), True
        new_residuals, new_jacobian = _residuals(q, x + step)
        if new_residuals @ new_residuals <= residuals @ residuals:
            x, residuals, jacobian = x + step, new_residuals, new_jacobian
            damping = max(damping * 0.1, 1e-15)
        else:
            damping *= 10.0
            if damping > 1.0:  # no descent beyond rounding is left
                return x[:3], float(x[3]), True
    return x[:3], float(x[3]), False


def _residuals(q: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Return distances to the sphere (n,) and their derivatives by centre and radius (n, 4)."""
    offsets = q - x[:3]
    distances = np.maximum(np.linalg.norm(offsets, axis=1), 1e-300)
    jacobian = np.column_stack((-offsets / distances[:, None], -np.ones(len(q))))
    return distances - x[3], jacobian


def _center_covariance(directions: Floats, residuals: Floats) -> Floats:
    """Return the covariance (3, 3) of the centre, from the scatter left over."""
    freedom = len(residuals) - 4
    if freedom <= 0:
        return np.zeros((3, 3))
    jacobian = np.column_stack((directions, np.ones(len(directions))))
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * (residuals @ residuals) / freedom
    return covariance[:3, :3].copy()
