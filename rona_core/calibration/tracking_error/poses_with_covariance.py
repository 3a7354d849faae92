"""Poses of a tracked body with the covariance of their errors.

A tracker fits the known marker geometry to noisy markers. To first order the fitted pose holds all
of the markers, so its covariance is the likelihood that a calibration needs.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.tracking_error.marker_noise import MarkerNoise
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3, as_points, readonly
from rona_core.geometry.pose import Poses
from rona_core.geometry.pose_covariance import cross_matrices

MIN_SPREAD = 0.02  # second over first width of 6D markers; first width in mm is checked too
MIN_WIDTH_MM = 1.0
MAX_OFF_LINE_MM = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class TrackedPoses:
    """n poses of ``marker`` in ``tracker`` and the covariance of their errors.

    The true pose is the measured one turned by -turn and moved by -shift, both in ``tracker``; the
    turn is about the point ``reference_marker``, the centroid of all markers.
    """

    Ts_tracker_marker: Poses
    reference_marker: Vector3  # (3,) mm
    covariances: Floats  # (n, 6, 6) of turn (rad) and shift (mm), if the 3D RMS of a marker is 1 mm

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
    )
