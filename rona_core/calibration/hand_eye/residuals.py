"""Residuals of the hand-eye equation, their Jacobians and covariances."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.calibration.tracking_error import MarkerNoise, fit_covariances
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import cross_matrices, rotation_vectors

SERIES = 1e-4  # of the angle; below it the expansion of the inverse Jacobian is exact enough
# Random error of the robot's tool pose, variances per axis:
TIP_VARIANCE_MM2 = 0.1**2 / 3.0  # of the tip, 0.1 mm 3D RMS
TURN_VARIANCE_RAD2 = float(np.deg2rad(0.02)) ** 2 / 3.0  # of its rotation, 0.02 degrees RMS


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Poses seen by robot and tracker, ready for the solve."""

    Ts_base_tip: Poses
    Ts_tracker_toolmarker: Poses
    centroid_toolmarker: Floats  # (3,) of the markers
    centroids_tracker: Floats  # (n, 3)
    unit_covariances: Floats  # (n, 6, 6) of (turn, shift) in tracker, marker error 1 mm 3D RMS

    def __len__(self) -> int:
        return len(self.Ts_base_tip)


def observe(
    Ts_base_tip: Poses,
    Ts_tracker_toolmarker: Poses,
    positions_toolmarker: Floats,
    noise: MarkerNoise,
) -> Observations:
    """Return the observations with the covariance of every pose that the tracker fits."""
    centroid = positions_toolmarker.mean(axis=0)
    return Observations(
        Ts_base_tip,
        Ts_tracker_toolmarker,
        centroid,
        Ts_tracker_toolmarker @ centroid,
        fit_covariances(Ts_tracker_toolmarker.rotations, positions_toolmarker, noise),
    )


def residuals(observations: Observations, T_base_tracker: Pose, T_toolmarker_tip: Pose) -> Floats:
    """Return measured minus expected marker pose (n, 6): turn, shift of the centroid in tracker."""
    R_tracker_base = T_base_tracker.rotation.T
    expected = R_tracker_base @ observations.Ts_base_tip.rotations @ T_toolmarker_tip.rotation.T
    turns = rotation_vectors(
        observations.Ts_tracker_toolmarker.rotations @ np.swapaxes(expected, 1, 2)
    )
    centroid_tip = T_toolmarker_tip.inv() @ observations.centroid_toolmarker
    centroids_base = observations.Ts_base_tip @ centroid_tip
    shifts = observations.centroids_tracker - T_base_tracker.inv() @ centroids_base
    return np.concatenate((turns, shifts), axis=1)


def jacobians(
    observations: Observations,
    T_base_tracker: Pose,
    T_toolmarker_tip: Pose,
    turns: Floats,
    center_base: Floats,
) -> Floats:
    """Return the derivatives (n, 6, 12) of the residuals.

    The columns are the deviation of ``T_base_tracker`` turned about ``center_base`` instead of the
    tracker (which keeps the equations well conditioned), then that of ``T_toolmarker_tip``.
    """
    n = len(observations)
    R_tracker_base = T_base_tracker.rotation.T
    R_expected = R_tracker_base @ observations.Ts_base_tip.rotations @ T_toolmarker_tip.rotation.T
    inverse = _inverse_right_jacobians(turns)
    lever_toolmarker = observations.centroid_toolmarker - T_toolmarker_tip.translation
    centroid_tip = T_toolmarker_tip.rotation.T @ lever_toolmarker
    levers_base = observations.Ts_base_tip @ centroid_tip - center_base
    J = np.zeros((n, 6, 12))
    J[:, :3, :3] = inverse @ R_tracker_base
    J[:, :3, 6:9] = inverse @ R_expected
    J[:, 3:, :3] = -R_tracker_base @ cross_matrices(levers_base)
    J[:, 3:, 3:6] = R_tracker_base
    J[:, 3:, 6:9] = -R_expected @ cross_matrices(lever_toolmarker)
    J[:, 3:, 9:] = R_expected
    return J


def moved(
    T_base_tracker: Pose, T_toolmarker_tip: Pose, step: Floats, center_base: Floats
) -> tuple[Pose, Pose]:
    """Return both poses after a step (12,) in the tangent of ``jacobians``."""
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    R_base_tracker = turn @ T_base_tracker.rotation
    arm = turn @ (T_base_tracker.translation - center_base)
    turned = Rotation.from_rotvec(step[6:9]).as_matrix() @ T_toolmarker_tip.rotation
    return (
        Pose(R_base_tracker, center_base + arm + step[3:6]),
        Pose(turned, T_toolmarker_tip.translation + step[9:]),
    )


def tangent_at_tracker(T_base_tracker: Pose, center_base: Floats) -> Floats:
    """Return the matrix (12, 12) from the tangent of ``jacobians`` to that of pose_covariance."""
    change = np.eye(12)
    change[3:6, :3] = -cross_matrices(T_base_tracker.translation - center_base)
    return change


def robot_covariances(
    observations: Observations, T_base_tracker: Pose, T_toolmarker_tip: Pose
) -> Floats:
    """Return what the robot's own error adds to the residuals: covariances (n, 6, 6)."""
    centroid_tip = T_toolmarker_tip.inv() @ observations.centroid_toolmarker
    levers = observations.Ts_base_tip.rotations @ centroid_tip @ T_base_tracker.rotation
    crossed = cross_matrices(levers)
    covariances = np.zeros((len(observations), 6, 6))
    covariances[:, :3, :3] = TURN_VARIANCE_RAD2 * np.eye(3)
    covariances[:, :3, 3:] = TURN_VARIANCE_RAD2 * crossed
    covariances[:, 3:, :3] = -TURN_VARIANCE_RAD2 * crossed
    covariances[:, 3:, 3:] = TIP_VARIANCE_MM2 * np.eye(3) - TURN_VARIANCE_RAD2 * crossed @ crossed
    return covariances


def _inverse_right_jacobians(turns: Floats) -> Floats:
    """Return d Log(Exp(a) Exp(d)) / d d at d = 0 for rotation vectors a (n, 3)."""
    crossed = cross_matrices(turns)
    angle = np.linalg.norm(turns, axis=1)
    safe = np.where(angle > SERIES, angle, 1.0)
    exact = 1.0 / safe**2 - 1.0 / (2.0 * safe * np.tan(safe / 2.0))
    factor = np.where(angle > SERIES, exact, 1.0 / 12.0)
    return np.eye(3) + crossed / 2.0 + factor[:, None, None] * (crossed @ crossed)
