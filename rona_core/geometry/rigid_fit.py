"""Least-squares fits: rigid motion between point sets, plane and line.

Each refuses points that do not determine its answer, with the number that says why.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Vector3, as_floats, as_points, readonly
from rona_core.geometry.pose import Pose, Poses, determinants

MIN_WIDTH = 0.01  # width over length of a point set; thinner sets leave a turn undetermined
MAX_THICKNESS = 0.9  # thickness over width of a plane, or width over length of a line


@dataclass(frozen=True, slots=True, eq=False)
class RigidFit:
    """A rigid motion between two point sets and what it leaves over."""

    T_b_a: Pose
    rms_mm: float
    residuals_mm: Floats  # (n,) distance of each mapped point from its partner


@dataclass(frozen=True, slots=True, eq=False)
class ManyFits:
    """The pose of frame ``a`` in ``b`` for each measurement, and what it leaves over."""

    Ts_b_a: Poses  # n poses
    rms_mm: Floats  # (n,) over the points that were there


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
    T_b_a = fit_rigid_many(a, b[None], np.ones((1, len(a)), dtype=np.bool_)).Ts_b_a[0]
    residuals = np.linalg.norm(T_b_a @ a - b, axis=1)
    return RigidFit(T_b_a, float(np.sqrt((residuals**2).mean())), readonly(residuals))


def fit_rigid_many(points_a: ArrayLike, points_b: ArrayLike, there: ArrayLike) -> ManyFits:
    """Return for each of n measurements the pose that maps ``points_a`` best onto it.

    The same as `register_points` one by one, on the points present.

    Args:
        points_a: The known points (m, 3) in frame ``a``, in mm.
        points_b: The measurements (n, m, 3) in frame ``b``; rows of missing points do not count.
        there: Which points are present (n, m), at least three in each measurement.

    Raises:
        InvalidInputError: wrong shape, values not finite, fewer than three points present.
        DegenerateGeometryError: those present lie on one line, or mirror each other.

    Source: Kabsch, Acta Cryst. A32 (1976) 922.
    """
    a, b, w = _checked(points_a, points_b, there, at_least=3)
    count = w.sum(axis=1)
    mean_a = (w @ a) / count[:, None]
    mean_b = np.einsum("nm,nmi->ni", w, b) / count[:, None]
    from_mean_b = (b - mean_b[:, None]) * w[:, :, None]
    u, s, vt = np.linalg.svd(np.einsum("nmi,nmj->nij", from_mean_b, a - mean_a[:, None]))
    handed = np.where(determinants(u @ vt) > 0.0, 1.0, -1.0)
    strength = s[:, 1] + handed * s[:, 2]
    weak = strength <= MIN_WIDTH**2 * s[:, 0]
    if weak.any():
        i = int(np.argmax(weak))
        raise DegenerateGeometryError(
            f"the {int(count[i])} points of measurement {i} do not determine a rotation: they lie "
            "on one line or are mirrored",
            row=i,
        )
    u[:, :, 2] *= handed[:, None]
    rotations = u @ vt
    translations = mean_b - np.einsum("nij,nj->ni", rotations, mean_a)
    return _result(a, b, w, rotations, translations)


def fit_line_many(along_mm: ArrayLike, points_b: ArrayLike, there: ArrayLike) -> ManyFits:
    """Return for each of n measurements the pose of a straight line of points.

    The points lie on the z axis of ``a``. The turn about it cannot be seen: each rotation is the
    smallest one that takes the z axis of ``b`` to the line.

    Args:
        along_mm: Places (m,) of the points on the z axis.
        points_b: The measurements (n, m, 3); rows of missing points do not count.
        there: Which points are present (n, m), at least two in each measurement.

    Raises:
        InvalidInputError: wrong shape, values not finite, fewer than two points present.
        DegenerateGeometryError: those present coincide.
    """
    z = as_floats(along_mm, name="along_mm")
    line_a = np.column_stack((np.zeros((len(z), 2)), z))
    a, b, w = _checked(line_a, points_b, there, at_least=2)
    count = w.sum(axis=1)
    mean_z = (w @ z) / count
    mean_b = np.einsum("nm,nmi->ni", w, b) / count[:, None]
    directions = np.einsum("nm,nmi->ni", w * (z - mean_z[:, None]), b - mean_b[:, None])
    lengths = np.linalg.norm(directions, axis=1)
    if (lengths <= 0.0).any():
        i = int(np.argmin(lengths))
        raise DegenerateGeometryError(f"the points of measurement {i} coincide", row=i)
    directions = directions / lengths[:, None]
    translations = mean_b - mean_z[:, None] * directions
    return _result(a, b, w, smallest_rotations(directions), translations)


def smallest_rotations(directions: Floats) -> Floats:
    """Return the smallest rotations (n, 3, 3) that take (0, 0, 1) to unit vectors (n, 3).

    For the opposite direction, where it is not unique, the half turn about x is taken.
    """
    x, y, z = directions.T
    lateral = x * x + y * y
    opposite = (z < 0.0) & (lateral < 1e-24)
    near = z > 0.0  # the other expression is the same, without cancellation beyond 90 degrees
    safe = np.where(lateral > 0.0, lateral, 1.0)
    share = np.where(near, 1.0 / (1.0 + np.where(near, z, 0.0)), (1.0 - z) / safe)
    rows = (
        (1.0 - share * x * x, -share * x * y, x),
        (-share * x * y, 1.0 - share * y * y, y),
        (-x, -y, z),
    )
    rotations = np.array(rows).transpose(2, 0, 1).copy()
    rotations[opposite] = np.diag((1.0, -1.0, -1.0))
    return rotations


def _checked(
    points_a: ArrayLike, points_b: ArrayLike, there: ArrayLike, *, at_least: int
) -> tuple[Floats, Floats, Floats]:
    a = as_points(points_a, at_least=at_least, name="points_a")
    present: Bools = np.asarray(there, dtype=np.bool_)
    raw = np.asarray(points_b, dtype=np.float64)
    if raw.ndim != 3 or raw.shape[1:] != a.shape or present.shape != raw.shape[:2]:
        raise InvalidInputError(
            f"expected points_b (n, {len(a)}, 3) and there (n, {len(a)}), "
            f"not {raw.shape} and {present.shape}"
        )
    b = as_floats(np.where(present[:, :, None], raw, 0.0), name="points_b")
    few = present.sum(axis=1) < at_least
    if few.any():
        i = int(np.argmax(few))
        raise InvalidInputError(
            f"measurement {i} has {int(present[i].sum())} points, {at_least} are the least"
        )
    return a, b, present.astype(np.float64)


def _result(a: Floats, b: Floats, w: Floats, rotations: Floats, translations: Floats) -> ManyFits:
    poses = Poses.unchecked(rotations, translations)
    squares = ((poses.map_points(a) - b) ** 2).sum(axis=2) * w
    rms_mm = np.sqrt(squares.sum(axis=1) / w.sum(axis=1))
    return ManyFits(poses, readonly(rms_mm))


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


ROUND_MM = (20.0, 500.0)  # radius of what bulges: smaller is noise, larger is flat
UPWARD = np.array((0.0, 0.0, 1.0))


def bulging(points: ArrayLike) -> Vector3:
    """Return the direction (3,) in which a patch of points (n, 3) bulges; of a flat one upward.

    That is from the centre of the sphere that fits the points to their middle.
    """
    p = as_points(points, at_least=4)
    middle = p.mean(axis=0)
    away = p - middle
    rows = np.column_stack((2.0 * away, np.ones(len(p))))
    found, _, rank, _ = np.linalg.lstsq(rows, np.einsum("ij,ij->i", away, away))
    distance_mm = float(np.linalg.norm(found[:3]))
    if rank < 4 or not ROUND_MM[0] <= distance_mm <= ROUND_MM[1]:
        return UPWARD
    return -found[:3] / distance_mm
