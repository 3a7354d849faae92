"""Error of a robot's tip by small errors of its links, posture by posture.

Each of the six links is shifted and turned a little against its drawing. To first order these add
up at the tip (Mooring 1991), so the errors of two postures go together as far as the postures are
alike: most of the error is common to a small region, and less where the arm is turned otherwise.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.geometry.pose_covariance import cross_matrices
from rona_core.robot.kinematics.arm import wrapped
from rona_core.robot.kinematics.robot_model import RobotModel

ROBOT_ACCURACY_MM = 0.35  # 3D RMS of the tip, as the paper states for its arm
ALIKE_RAD = np.deg2rad(45.0)  # no joint of postures that are alike differs by more


def largest_step_rad(qs_rad: Floats, others_rad: Floats) -> Floats:
    """Return by how much (...) the joint that moves most differs between postures (..., 6)."""
    return np.abs(wrapped(qs_rad - others_rad)).max(axis=-1)


def alike(qs_rad: Floats, others_rad: Floats) -> Bools:
    """Return where two postures (..., 6) are so much alike that errors of the links are, too."""
    return largest_step_rad(qs_rad, others_rad) <= ALIKE_RAD


def link_errors(
    model: RobotModel, qs_rad: Floats, T_flange_tip: Pose, accuracy_mm: float
) -> Floats:
    """Return how errors of the links turn the tool and shift a point of it.

    Times 36 independent standard normal numbers these are errors at the postures. Shifts and turns
    are taken to be the same for all links and axes, and each to make half of the variance: makers
    state the sum alone.

    Args:
        model: The robot.
        qs_rad: Postures (n, 6).
        T_flange_tip: Of the point that is shifted.
        accuracy_mm: 3D RMS of its shift over these postures, as stated.

    Returns:
        Turns in rad and shifts in mm, in ``base`` (n, 6, 36).
    """
    rotations, origins = (part[:, 1:] for part in model.arm.link_frames(qs_rad))
    points = (model.forward(qs_rad) @ T_flange_tip).translations
    arms = cross_matrices(points[:, None] - origins)
    shifts = np.concatenate((np.zeros_like(rotations), rotations), axis=2)  # (n, links, 6, 3)
    turns = np.concatenate((rotations, -arms @ rotations), axis=2)
    scaled = [
        part * (accuracy_mm / np.sqrt(2.0 * (part[:, :, 3:] ** 2).sum() / len(qs_rad)))
        for part in (shifts, turns)
    ]
    return np.swapaxes(np.concatenate(scaled, axis=1), 1, 2).reshape(len(qs_rad), 6, 36)


def tip_sensitivities(
    model: RobotModel, qs_rad: Floats, normals_base: Floats, accuracy_mm: float
) -> Floats:
    """Return how errors of the links move the face of the probe along normals.

    Row i times 36 independent standard normal numbers is an error at posture i; the covariance of
    the errors of n postures is A @ A.T.

    Args:
        model: The robot.
        qs_rad: Postures (n, 6).
        normals_base: Directions (n, 3) in ``base`` along which the error counts.
        accuracy_mm: 3D RMS error of the tip, as stated.

    Returns:
        The sensitivities (n, 36), in mm.
    """
    errors = link_errors(model, qs_rad, model.T_flange_probe, accuracy_mm)
    return np.einsum("nij,ni->nj", errors[:, 3:], normals_base)
