"""Poses of a tracked body with the covariance of their errors.

A tracker fits the known marker geometry to noisy markers. To first order the fitted pose holds all
that the markers tell, so its covariance is the likelihood that a calibration needs.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from rona_core.calibration.tracking_error.marker_noise import MarkerNoise
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Vector3, as_floats, as_points, readonly
from rona_core.geometry.pose import Poses
from rona_core.geometry.pose_covariance import cross_matrices

MIN_SPREAD = 0.02  # second over first width of 6D markers; first width in mm is checked too
MIN_WIDTH_MM = 1.0
MAX_OFF_LINE_MM = 1e-3
FIT_STEPS = 20
FIT_TOLERANCE = 1e-11


@dataclass(frozen=True, slots=True, eq=False)
class TrackedPoses:
    """n poses of ``marker`` in ``tracker`` and the covariance of their errors.

    The true pose is the measured one turned by -turn and moved by -shift, both in ``tracker``; the
    turn is about the point ``reference_marker``, the centroid of all markers.
    """

    Ts_tracker_marker: Poses
    reference_marker: Vector3  # (3,) mm
    covariances: Floats  # (n, 6, 6) of turn (rad) and shift (mm), if the 3D RMS of a marker is 1 mm
    seen: Bools  # (n,) False where too few markers were seen; the pose there means nothing
    misfit: Floats  # (n,) sum of squared whitened marker residuals; 0 where only poses are known
    freedom: Floats  # (n,) its degrees of freedom

    def centers_tracker(self) -> Floats:
        """Return where the reference point was measured (n, 3)."""
        return self.Ts_tracker_marker @ self.reference_marker


def as_marker_positions(positions_marker: ArrayLike, dof: int) -> Floats:
    """Return marker positions (m, 3) after checking that they suit a tool of ``dof`` freedoms.

    Raises:
        InvalidInputError: wrong shape, too few markers, or 5D markers beside the z axis.
        DegenerateGeometryError: markers in one place, or 6D markers on one line.
    """
    p = as_points(positions_marker, at_least=3 if dof == 6 else 2, name="positions_marker")
    widths = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    if widths[0] < MIN_WIDTH_MM or (dof == 6 and widths[1] < MIN_SPREAD * widths[0]):
        raise DegenerateGeometryError(
            f"{len(p)} markers lie in one place or on one line ({widths[0]:.3g} x {widths[1]:.3g} "
            f"mm): no {dof}D tool"
        )
    if dof == 5 and np.abs(p[:, :2]).max() > MAX_OFF_LINE_MM:
        raise InvalidInputError("the markers of a 5D tool must lie on the z axis of its frame")
    return p


def tracked_from_poses(
    Ts_tracker_marker: Poses, positions_marker: ArrayLike, noise: MarkerNoise, *, dof: int
) -> TrackedPoses:
    """Return poses with the covariance of an unweighted fit of all markers, as trackers make it.

    Args:
        Ts_tracker_marker: n measured poses.
        positions_marker: Marker geometry (m, 3) in mm.
        noise: What is assumed about single markers.
        dof: 6; or 5 for markers on the z axis of ``marker``, whose roll means nothing.

    Raises:
        InvalidInputError, DegenerateGeometryError: as in :func:`as_marker_positions`.
    """
    p = as_marker_positions(positions_marker, dof)
    n, m = len(Ts_tracker_marker), len(p)
    arms = p - p.mean(axis=0)
    R = Ts_tracker_marker.rotations
    S = np.diag(noise.shape() ** 2)  # of one marker in tracker
    covariances = np.zeros((n, 6, 6))
    covariances[:, 3:, 3:] = S / m
    if dof == 6:
        crosses = cross_matrices(arms)
        inertia = np.linalg.inv(np.einsum("kba,kbc->ac", crosses, crosses))
        S_marker = np.swapaxes(R, 1, 2) @ S @ R
        torque = np.einsum("kba,nbc,kcd->nad", crosses, S_marker, crosses, optimize=True)
        covariances[:, :3, :3] = R @ (inertia @ torque @ inertia) @ np.swapaxes(R, 1, 2)
    else:
        shafts = cross_matrices(R[:, :, 2])
        covariances[:, :3, :3] = shafts @ S @ np.swapaxes(shafts, 1, 2) / (arms[:, 2] ** 2).sum()
    return TrackedPoses(
        Ts_tracker_marker=Ts_tracker_marker,
        reference_marker=readonly(p.mean(axis=0)),
        covariances=readonly(covariances),
        seen=readonly(np.ones(n, dtype=np.bool_)),
        misfit=readonly(np.zeros(n)),
        freedom=readonly(np.zeros(n)),
    )


def tracked_from_markers(
    points_tracker: ArrayLike,
    positions_marker: ArrayLike,
    noise: MarkerNoise,
    *,
    dof: int,
    seen: ArrayLike | None = None,
) -> TrackedPoses:
    """Return the poses that fit raw markers best under ``noise``, with their covariance.

    Args:
        points_tracker: Measured markers (n, m, 3) in mm; values of unseen markers are ignored.
        positions_marker: Marker geometry (m, 3) in mm.
        noise: What is assumed about single markers.
        dof: 6; or 5 for markers on the z axis of ``marker``.
        seen: (n, m) which markers were seen; all if None.

    Raises:
        InvalidInputError, DegenerateGeometryError: as in :func:`as_marker_positions`, or arrays
            that do not belong together.
    """
    p = as_marker_positions(positions_marker, dof)
    mask, y = _as_markers(points_tracker, seen, len(p))
    enough = mask.sum(axis=1) >= (3 if dof == 6 else 2)
    mask = np.where(enough[:, None], mask, True)  # so that every frame solves; these are never used
    y = np.where(enough[:, None, None], y, p)
    reference = p.mean(axis=0)
    arms = p - reference
    rotations, t = _start(arms, y, mask, dof)
    precision = np.diag(noise.shape() ** -2.0)
    rotations, t, information = _gauss_newton(rotations, t, arms, y, mask, precision, dof)
    covariances: Floats = np.asarray(np.linalg.inv(information), dtype=np.float64)
    if dof == 5:
        rolls = rotations[:, :, 2:]
        covariances[:, :3, :3] -= rolls @ np.swapaxes(rolls, 1, 2)
    lever = np.einsum("nij,kj->nki", rotations, arms)
    left = np.where(mask[:, :, None], y - t[:, None] - lever, 0.0)
    return TrackedPoses(
        Ts_tracker_marker=Poses(rotations, t - rotations @ reference),
        reference_marker=readonly(reference),
        covariances=readonly(covariances),
        seen=readonly(enough),
        misfit=readonly(np.where(enough, np.einsum("nki,ij,nkj->n", left, precision, left), 0.0)),
        freedom=readonly(np.where(enough, 3.0 * mask.sum(axis=1) - dof, 0.0)),
    )


def _gauss_newton(
    rotations: Floats,
    t: Floats,
    arms: Floats,
    y: Floats,
    mask: Bools,
    precision: Floats,
    dof: int,
) -> tuple[Floats, Floats, Floats]:
    """Fit rotations (n, 3, 3) and translations (n, 3) to markers, and return the information.

    Residuals r = y - t - R a with the Jacobian (-[R a]x, 1) by a turn of R and a shift of t; the
    normal equations are (sum J' P J) step = sum J' P r. The information is (n, 6, 6).
    """
    information: Floats = np.zeros((len(y), 6, 6))
    for _ in range(FIT_STEPS):
        lever = np.einsum("nij,kj->nki", rotations, arms)
        residuals = np.where(mask[:, :, None], y - t[:, None] - lever, 0.0)
        jacobian = np.zeros((*mask.shape, 3, 6))
        jacobian[..., :3] = -cross_matrices(lever)
        jacobian[..., 3:] = np.eye(3)
        jacobian *= mask[:, :, None, None]
        information = np.einsum("nkia,ij,nkjb->nab", jacobian, precision, jacobian, optimize=True)
        rolls = rotations[:, :, 2:]
        if dof == 5:  # the roll, which no marker shows, stays as it is
            information[:, :3, :3] += rolls @ np.swapaxes(rolls, 1, 2)
        gradient = np.einsum("nkia,ij,nkj->na", jacobian, precision, residuals, optimize=True)
        step = np.linalg.solve(information, gradient[..., None])[..., 0]
        rotations, t = Rotation.from_rotvec(step[:, :3]).as_matrix() @ rotations, t + step[:, 3:]
        if np.abs(step).max(initial=0.0) < FIT_TOLERANCE * np.abs(arms).max():
            break
    return rotations, t, information


def _as_markers(points: ArrayLike, seen: ArrayLike | None, m: int) -> tuple[Bools, Floats]:
    """Return the mask (n, m) and the markers (n, m, 3), zero where unseen."""
    y = np.array(points, dtype=np.float64)
    if y.ndim != 3 or y.shape[1:] != (m, 3):
        raise InvalidInputError(f"points_tracker must have shape (n, {m}, 3), not {y.shape}")
    mask = np.ones(y.shape[:2], dtype=np.bool_) if seen is None else np.asarray(seen)
    if mask.shape != y.shape[:2] or mask.dtype != np.bool_:
        raise InvalidInputError(f"seen must be bool of shape {y.shape[:2]}, not {mask.shape}")
    return mask, as_floats(np.where(mask[:, :, None], y, 0.0), name="points_tracker")


def _start(arms: Floats, y: Floats, mask: Bools, dof: int) -> tuple[Floats, Floats]:
    """Return rotations (n, 3, 3) and reference points (n, 3) by the unweighted fit."""
    count = mask.sum(axis=1)
    mean = np.einsum("nki,nk->ni", y, mask) / count[:, None]
    middle = mask @ arms / count[:, None]
    a = (arms - middle[:, None]) * mask[:, :, None]
    b = (y - mean[:, None]) * mask[:, :, None]
    if dof == 5:
        shaft = np.einsum("nk,nki->ni", a[:, :, 2], b)
        rotations = rotations_to(shaft / np.linalg.norm(shaft, axis=1)[:, None])
    else:
        u, _, vt = np.linalg.svd(np.einsum("nki,nkj->nij", b, a))
        u[:, :, 2] *= (np.linalg.det(u) * np.linalg.det(vt))[:, None]
        rotations = u @ vt
    return rotations, mean - np.einsum("nij,nj->ni", rotations, middle)


def rotations_to(directions: Floats) -> Floats:
    """Return for each unit vector (n, 3) some rotation (n, 3, 3) that takes z to it."""
    least = np.eye(3)[np.abs(directions).argmin(axis=1)]
    cross = cross_matrices(directions)
    x = np.einsum("nij,nj->ni", cross, least)
    x /= np.linalg.norm(x, axis=1)[:, None]
    return np.stack((x, np.einsum("nij,nj->ni", cross, x), directions), axis=2)
