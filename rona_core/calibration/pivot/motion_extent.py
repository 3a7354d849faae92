"""Motion of a pivoted body: its sphere, its extent, and why poses determine no tip.

Sphere fit to tracked positions: algebraic start, then geometric least squares. Start: linear least
squares (Coope 1993). Then the sum of squared distances to the sphere is minimised, which has no
bias towards small spheres on small caps.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from rona_core.calibration.pivot.maximum_likelihood import robust_initial_guess
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats, Vector3, as_points, readonly
from rona_core.geometry.pose import Poses

# Two measured poses differ by more, because a tracker has noise; the same pose may differ by this
# once it was printed with six digits, or converted.
SAME_MM = 5e-3
SAME_RAD = 5e-5


def repeated_poses(Ts_a_b: Poses) -> Bools:
    """Return which poses (n,) say again what the pose before them said.

    A run of equal poses is one measurement, however many rows it has: all but its first are True.
    """
    turned = np.abs(np.diff(Ts_a_b.rotations, axis=0)).max(axis=(1, 2), initial=0.0)
    moved = np.abs(np.diff(Ts_a_b.translations, axis=0)).max(axis=1, initial=0.0)
    same = (turned <= SAME_RAD) & (moved <= SAME_MM)
    return readonly(np.concatenate((np.zeros(min(len(Ts_a_b), 1), dtype=np.bool_), same)))


REFUSALS: dict[str, tuple[str, str]] = {  # cause: words, remedy
    "still": (
        "the marker hardly turned ({degrees:.2g} degrees)",
        "swing it about its tip",
    ),
    "repeated": (
        "only {n} of {all} poses differ from the one before, {least} are needed",
        "keep the marker in view of the tracker, which repeats its last pose, and swing on",
    ),
    "one plane": (
        "the swing stays in one plane ({strongest:.1f} degrees one way, {weakest:.2g} the other)",
        "swing in two directions",
    ),
    "small": (
        "the swing covers only about {degrees:.1f} degrees half-angle, {least:.0f} are needed",
        "swing further, to 20 degrees and more",
    ),
    "narrow": (
        "the swing covers a cone of only {degrees:.1f} degrees half-angle, {least:.0f} are needed",
        "swing further, to 20 degrees and more",
    ),
    "slipped": (
        "the tip has slipped: up to pose {row} it was {distance:.1f} mm from where it was then",
        "hold it in one place and swing again, or use only the poses before that or only those "
        "after it",
    ),
    "loose": (
        "the marker has moved on its tool: up to pose {row} the tip was {distance:.1f} mm from "
        "where it was in the marker then",
        "fasten the marker and swing again, or use only the poses before that or only those after "
        "it",
    ),
    "disagree": (
        "{n} of {all} poses disagree with the tip that the others share, here and there",
        "look for reflections, for markers that were covered or exchanged, and leave such poses "
        "out",
    ),
    "no common tip": (
        "the poses share no tip: where it fits best, it scatters by {scatter:.1f} mm",
        "rest the tip in one place, fasten the marker to its tool, and use poses of this marker "
        "in the tracker",
    ),
    "behind": (
        "the tip lies {distance:.1f} mm behind the markers",
        "turn the z axis of the marker, which must point to the tip",
    ),
}
AGREE_MM = 3.0  # the tip scatters less (median) where it stayed in one place
APART = 4.0  # scatters by which two places are different ones
FITS = 0.8  # of the poses agree with one of two places
SPLITS = np.linspace(0.1, 0.9, 17)  # of the motion, where a move is looked for


def refusal(cause: str, **figures: float) -> DegenerateGeometryError:
    """Return the error of a cause; its ``data`` has the cause, as in `REFUSALS`."""
    words, remedy = REFUSALS[cause]
    return DegenerateGeometryError(f"{words.format(**figures)}: {remedy}", cause=cause)


def disagreement(
    levers: Floats, p: Floats, keep: Bools, scatter_mm: float | None = None
) -> DegenerateGeometryError:
    """Return why too few poses share a tip: it moved at one time, some poses are wrong, or all.

    Args:
        levers: (n, 3, k) directions, in ``tracker``, of the k ways in which the tip may move.
        p: (n, 3) where each pose puts the origin of these ways, in mm.
        keep: (n,) poses that may count.
        scatter_mm: Of the tip about its pivot, where a fit has one; else a median.
    """
    rows = np.flatnonzero(keep)
    levers, p = levers[rows], p[rows] - p[rows].mean(axis=0)
    moved = np.broadcast_to(-np.eye(3), (len(p), 3, 3))
    for cause, ways in (("slipped", moved), ("loose", levers)):
        found = _moved_once(levers, p, ways)
        if found is not None:
            return refusal(cause, row=int(rows[found[0] - 1]), distance=found[1])
    whole = robust_initial_guess(levers, p, np.ones(len(p), dtype=np.bool_))
    misses = _misses(levers, p, whole)
    scatter = float(np.median(misses))
    out = int((misses > APART * scatter).sum())
    if scatter <= AGREE_MM and out:
        return refusal("disagree", n=out, all=len(rows))
    return refusal("no common tip", scatter=scatter if scatter_mm is None else scatter_mm)


def _moved_once(levers: Floats, p: Floats, ways: Floats) -> tuple[int, float] | None:
    """Return after how many poses tip or pivot moved (ways (n, 3, j)) and how far; None if not."""
    n, j = len(p), ways.shape[2]
    everywhere, order = np.ones(n, dtype=np.bool_), np.arange(n)
    best: tuple[float, Floats] | None = None
    for split in np.unique((SPLITS * n).astype(np.int64)):
        after = np.where((order >= split)[:, None, None], ways, 0.0)
        x = robust_initial_guess(np.concatenate((levers, after), axis=2), p, everywhere)
        left = _misses(np.concatenate((levers, after), axis=2), p, x)
        cost = float(np.minimum(left, AGREE_MM).sum())
        if best is None or cost < best[0]:
            best = cost, x
    if best is None:
        return None
    x = best[1]
    without = _misses(levers, p, np.delete(x, np.s_[-3 - j : -3]))
    within = _misses(np.concatenate((levers, ways), axis=2), p, x)
    # the first k poses without the move, the others with it
    bounded = np.minimum(np.stack((without, within)), AGREE_MM * APART)
    costs = np.append(0.0, bounded[0].cumsum()) + np.append(bounded[1][::-1].cumsum()[::-1], 0.0)
    k = int(costs.argmin())
    left = np.where(order < k, without, within)
    scatter = float(np.median(left))
    distance = float(np.linalg.norm(x[-3 - j : -3]))
    agree = float((left <= APART * max(scatter, 1e-6)).mean())
    if not 0 < k < n or scatter > AGREE_MM or agree < FITS or distance < APART * scatter:
        return None
    return k, distance


def _misses(levers: Floats, p: Floats, x: Floats) -> Floats:
    return np.linalg.norm(levers @ x[:-3] + p - x[-3:], axis=1)


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


MIN_CONE_DEG = 5.0  # half-angle that the lever must cover
MIN_CROSS_DEG = 2.5  # half-angle of an even cone that turns as much about its weakest axis
STATIC_DEG = 1.0


def require_cone(levers: Floats) -> float:
    """Return the half-angle (deg) of the cone that unit vectors (n, 3) cover.

    Raises:
        DegenerateGeometryError: less than 5 degrees.
    """
    cone_deg = cap_half_angle_deg(levers)
    if cone_deg < MIN_CONE_DEG:
        raise refusal("narrow", degrees=cone_deg, least=MIN_CONE_DEG)
    return cone_deg


def swing_of_shaft_deg(shafts: Floats) -> tuple[float, float]:
    """Return by how much unit vectors (n, 3) swing in their weakest and strongest direction.

    Both are half-angles of the even cone that swings as much.
    """
    mean = shafts.mean(axis=0)
    across = np.linalg.svd(mean[None] / np.linalg.norm(mean))[2][1:]  # plane across the shaft
    tilts = (shafts - mean) @ across.T
    spread = np.linalg.eigvalsh(tilts.T @ tilts / len(tilts))
    weakest, strongest = np.rad2deg(2.0 * np.sqrt(np.maximum(spread, 0.0)))
    return float(weakest), float(strongest)


def require_swing(rotations: Floats, dof: int) -> None:
    """Refuse rotations that leave some direction of the tip open.

    ``mean |R v - mean(R v)|^2`` is how much a lever along v moves, per length squared. For an even
    cone of half-angle w without spin it is w^2 / 4 across the shaft, so 2 sqrt() is the angle.

    Args:
        rotations: (n, 3, 3) of the marker.
        dof: 6, or 5 where only the z axis is known.

    Raises:
        DegenerateGeometryError: static, in one plane, or too small.
    """
    deviations = rotations - rotations.mean(axis=0)
    if dof == 5:
        weakest, strongest = swing_of_shaft_deg(rotations[:, :, 2])
    else:
        moved = np.einsum("nji,njk->ik", deviations, deviations) / len(rotations)
        spread = np.linalg.eigvalsh(moved)
        weakest, _, strongest = np.rad2deg(2.0 * np.sqrt(np.maximum(spread, 0.0)))
    if strongest < STATIC_DEG:
        raise refusal("still", degrees=strongest)
    if weakest < MIN_CROSS_DEG and strongest > 2.0 * MIN_CROSS_DEG:
        raise refusal("one plane", strongest=strongest, weakest=weakest)
    if weakest < MIN_CROSS_DEG:
        raise refusal("small", degrees=strongest, least=MIN_CONE_DEG)
