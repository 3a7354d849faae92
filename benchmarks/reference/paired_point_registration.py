"""Register two frames by points that are known in both, and predict the error elsewhere.

FLE is the error of one fiducial, FRE what the fit leaves over at the fiducials, TRE the error of a
mapped place; each is a 3D RMS in mm. FRE says nothing about TRE (Fitzpatrick 1998); what does is
the covariance of the pose. To first order, with weights W and errors S (Danilchenko 2010),

    cov = A^-1 (sum J'W S W J) A^-1,  A = sum J'W J,  J_k = (-[R p_k - c]x, 1)
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_floats, as_points, readonly
from rona_core.geometry.pose import Pose
from rona_core.geometry.pose_covariance import as_covariance, cross_matrices, point_jacobians
from rona_core.geometry.rigid_fit import register_points

MIN_POINTS = 3
MAX_STEPS = 30
TOLERANCE = 1e-13


@dataclass(frozen=True, slots=True, eq=False)
class FiducialRegistration:
    """``T_b_a`` from points in both frames, its residuals and its covariance."""

    T_b_a: Pose
    covariance: Floats  # (6, 6) of the deviation of T_b_a, as geometry/pose_covariance.py says
    residuals_b: Floats  # (n, 3) point in b minus mapped point, mm; of those left out too
    residuals_mm: Floats  # (n,) their lengths
    leave_one_out_mm: Floats  # (n,) the same after a fit without that point; empty for 3 points
    used: Bools  # (n,)
    fre_mm: float  # RMS residual of the points used
    fle_mm: float  # RMS error of one point: estimated from FRE, or of the covariances given
    chi_square: float  # of the residuals over their degrees of freedom; 1 where FLE is estimated

    def target_covariances(self, targets_a: ArrayLike) -> Floats:
        """Return the covariances (k, 3, 3) in b, mm^2, of mapped places (k, 3)."""
        J = point_jacobians(self.T_b_a, targets_a)
        return J @ self.covariance @ np.swapaxes(J, 1, 2)

    def target_errors_mm(self, targets_a: ArrayLike) -> Floats:
        """Return the expected TRE (k,), 3D RMS, of mapped places (k, 3)."""
        return np.sqrt(np.trace(self.target_covariances(targets_a), axis1=1, axis2=2))


def register_fiducials(
    points_a: ArrayLike,
    points_b: ArrayLike,
    *,
    covariances: ArrayLike | None = None,
    weighted: bool = True,
    exclude: ArrayLike | None = None,
) -> FiducialRegistration:
    """Return ``T_b_a`` that maps ``points_a`` best onto ``points_b``, and how well it is known.

    Args:
        points_a: Fiducials in frame ``a`` (n, 3), mm, n >= 3.
        points_b: The same fiducials in frame ``b``, in the same order.
        covariances: Error of each pair in b, both sides together: (n, 3, 3) or one (3, 3), mm^2.
            None: alike in all directions, of a size that the residuals tell.
        weighted: Fit with the inverse covariances; otherwise as if they were alike, which is what
            most trackers do, but with the error that this has.
        exclude: (n,) True for fiducials to leave out.

    Raises:
        InvalidInputError: wrong shapes, values not finite, or a covariance that is none.
        DegenerateGeometryError: fewer than 3 fiducials, or on one line.
    """
    a = as_points(points_a, at_least=MIN_POINTS, name="points_a")
    b = as_points(points_b, at_least=MIN_POINTS, name="points_b")
    if len(a) != len(b):
        raise InvalidInputError(f"points must come in pairs: {len(a)} in a, {len(b)} in b")
    used = np.ones(len(a), dtype=np.bool_)
    if exclude is not None:
        used = ~np.asarray(exclude, dtype=np.bool_)
        if used.shape != (len(a),):
            raise InvalidInputError(f"exclude must have shape ({len(a)},), not {used.shape}")
    if used.sum() < MIN_POINTS:
        raise DegenerateGeometryError(f"{int(used.sum())} fiducials are left, 3 are needed")
    errors = _as_covariances(covariances, len(a))
    weights: Floats | None = None
    if errors is not None and weighted:
        weights = np.asarray(np.linalg.inv(errors), dtype=np.float64)
    T_b_a = _fit(a[used], b[used], None if weights is None else weights[used])
    off = b - T_b_a @ a
    degrees = 3 * int(used.sum()) - 6
    lengths = np.linalg.norm(off, axis=1)
    fre_mm = float(np.sqrt((lengths[used] ** 2).mean()))
    if errors is None:
        variance = float((off[used] ** 2).sum()) / degrees
        fle_mm, chi_square = float(np.sqrt(3.0 * variance)), 1.0
        spread = np.broadcast_to(variance * np.eye(3), (len(a), 3, 3))
    else:
        fle_mm = float(np.sqrt(np.trace(errors[used], axis1=1, axis2=2).mean()))
        chi_square = _chi_square(off[used], errors[used], degrees, weights is not None)
        spread = errors
    return FiducialRegistration(
        T_b_a=T_b_a,
        covariance=readonly(
            pose_covariance(
                T_b_a, a[used], spread[used], None if weights is None else weights[used]
            )
        ),
        residuals_b=readonly(off),
        residuals_mm=readonly(lengths),
        leave_one_out_mm=readonly(_leave_one_out(a, b, weights, used)),
        used=readonly(used),
        fre_mm=fre_mm,
        fle_mm=fle_mm,
        chi_square=chi_square,
    )


def pose_covariance(
    T_b_a: Pose, points_a: ArrayLike, covariances: ArrayLike, weights: Floats | None = None
) -> Floats:
    """Return the covariance (6, 6) of a pose fitted to points, before anything is measured.

    Args:
        T_b_a: The pose.
        points_a: Fiducials (n, 3).
        covariances: Their errors (n, 3, 3) in b.
        weights: What the fit weighs them by (n, 3, 3) in b; None: all alike.
    """
    p = as_points(points_a, at_least=MIN_POINTS, name="points_a")
    S = as_floats(covariances, name="covariances")
    turned = p @ T_b_a.rotation.T
    center = turned.mean(axis=0)  # turning about the centroid keeps the equations well conditioned
    eye = np.broadcast_to(np.eye(3), (len(p), 3, 3))
    J = np.concatenate((-cross_matrices(turned - center), eye), axis=2)
    W = eye if weights is None else weights
    normal = np.einsum("nji,njk,nkl->il", J, W, J)
    WJ = W @ J
    spread = np.einsum("nji,njk,nkl->il", WJ, S, WJ)
    gain = np.linalg.inv(normal)
    change = np.eye(6)
    change[3:, :3] = cross_matrices(center)  # the shift is that of the origin of a
    covariance = change @ gain @ spread @ gain @ change.T
    return (covariance + covariance.T) / 2.0


def _fit(a: Floats, b: Floats, weights: Floats | None) -> Pose:
    """Return the pose with the least weighted sum of squares, by Gauss-Newton from the even one."""
    T_b_a = register_points(a, b).T_b_a
    if weights is None:
        return T_b_a
    for _ in range(MAX_STEPS):
        turned = a @ T_b_a.rotation.T
        center = turned.mean(axis=0)
        eye = np.broadcast_to(np.eye(3), (len(a), 3, 3))
        J = np.concatenate((-cross_matrices(turned - center), eye), axis=2)
        WJ = weights @ J
        off = b - turned - T_b_a.translation
        step = np.linalg.solve(np.einsum("nji,njk->ik", J, WJ), np.einsum("nji,nj->i", WJ, off))
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        middle = center + T_b_a.translation + step[3:]
        T_b_a = Pose(turn @ T_b_a.rotation, middle - turn @ center)
        if np.abs(step[:3]).max() < TOLERANCE:
            break
    return T_b_a


def _chi_square(off: Floats, errors: Floats, degrees: int, weighted: bool) -> float:
    """Return how large the residuals are for the errors they should have; 1 on average."""
    if weighted:
        return float(np.einsum("ni,nij,nj->", off, np.linalg.inv(errors), off)) / degrees
    expected = float(np.trace(errors, axis1=1, axis2=2).sum()) * degrees / (3.0 * len(off))
    return float((off**2).sum()) / expected


def _leave_one_out(a: Floats, b: Floats, weights: Floats | None, used: Bools) -> Floats:
    """Return how far each point is off a fit without it (n,), empty where too few are left."""
    if used.sum() <= MIN_POINTS:
        return np.zeros(0)
    found = np.zeros(len(a))
    for i in range(len(a)):
        others = used.copy()
        others[i] = False
        try:
            T_b_a = _fit(a[others], b[others], None if weights is None else weights[others])
        except DegenerateGeometryError:
            return np.zeros(0)  # one point carries the fit: nothing checks it
        found[i] = np.linalg.norm(b[i] - T_b_a @ a[i])
    return found


def _as_covariances(covariances: ArrayLike | None, n: int) -> Floats | None:
    if covariances is None:
        return None
    c = as_floats(covariances, name="covariances")
    if c.shape == (3, 3):
        return np.broadcast_to(as_covariance(c, 3, name="covariances"), (n, 3, 3))
    if c.shape != (n, 3, 3):
        raise InvalidInputError(f"covariances must have shape ({n}, 3, 3), not {c.shape}")
    return np.array([as_covariance(one, 3, name=f"covariances[{i}]") for i, one in enumerate(c)])
