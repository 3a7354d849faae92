"""Quality of a hand-eye calibration: observability of the motion, verdict and its reasons.

With turns about one axis only, the tip may slide along that axis in the marker frame while the
tracker slides with it: not observable. Without turns the tip is open altogether.
"""

from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.geometry.pose_covariance import cross_matrices, rotation_vectors

STATIC_DEG = 0.5  # RMS turn about an axis; below it there is none
GOOD_MM, WEAK_MM = 0.3, 1.0  # predicted errors of a good registration, and of one of use at all
GOOD_TURN_DEG = 5.0  # RMS about the second axis; an even cone of 12 degrees has 6
REACH_MM = 100.0  # from the tips, where the registration is wanted
MAX_REJECTED = 0.1  # share
NOISY_MM = 1.0  # of a marker; trackers are ten times better
MATCH_DEG = 2.0  # robot and tracker turned by the same angle, or the pose is not asked


def turns_deg(rotations: Floats) -> tuple[Floats, Floats]:
    """Return the RMS turn about three axes (3,) in degrees, most first, and these axes (3, 3).

    Args:
        rotations: (n, 3, 3); the axes, in rows, are given in the body's own frame.
    """
    mean = Rotation.from_matrix(rotations).mean().as_matrix()
    vectors = rotation_vectors(mean.T @ rotations)
    _, sizes, axes = np.linalg.svd(vectors, full_matrices=False)
    padded = np.zeros(3)
    padded[: len(sizes)] = np.rad2deg(sizes / np.sqrt(len(vectors)))
    return padded, axes


def require_two_axes(rotations_base_tip: Floats, rotations_tracker_toolmarker: Floats) -> None:
    """Refuse a motion that leaves something open, and say what.

    Args:
        rotations_base_tip: By the robot (n, 3, 3).
        rotations_tracker_toolmarker: By the tracker (n, 3, 3), gross errors among them.

    Raises:
        DegenerateGeometryError: the tool turned about one axis only, or not at all.
    """
    sizes, axes_tip = turns_deg(rotations_base_tip)
    if sizes[0] < STATIC_DEG:
        raise DegenerateGeometryError(
            f"the tool did not turn ({sizes[0]:.2g} degrees): the tip in toolmarker and the "
            "tracker in base cannot be observed in any direction; pivot the tool"
        )
    if sizes[1] >= STATIC_DEG:
        return
    mean = Rotation.from_matrix(rotations_base_tip).mean().as_matrix()
    by_robot = rotation_vectors(mean.T @ rotations_base_tip)
    reference = int(np.argmax(np.abs(by_robot @ axes_tip[0])))
    robot = rotation_vectors(rotations_base_tip[reference].T @ rotations_base_tip)
    turns_toolmarker = rotations_tracker_toolmarker[reference].T @ rotations_tracker_toolmarker
    tracker = rotation_vectors(turns_toolmarker)
    apart = np.linalg.norm(tracker, axis=1) - np.linalg.norm(robot, axis=1)
    match = np.abs(apart) < np.deg2rad(MATCH_DEG)
    axis_toolmarker = np.linalg.svd(tracker[match], full_matrices=False)[2][0]
    raise DegenerateGeometryError(
        f"the tool turned about one axis only ({sizes[0]:.1f} degrees about it, {sizes[1]:.2g} "
        f"across): the tip along {in_words(axis_toolmarker)} of toolmarker, and with it the "
        f"tracker along {in_words(mean @ axes_tip[0])} of base, cannot be observed; tilt the tool "
        "about a second axis"
    )


def in_words(direction: Floats) -> str:
    """Return a direction as text, its largest component positive."""
    sign = np.sign(direction[np.argmax(np.abs(direction))])
    x, y, z = sign * direction + 0.0
    return f"({x:.2f}, {y:.2f}, {z:.2f})"


def registration_sigma_mm(T_base_tracker: Pose, covariance: Floats, center_base: Floats) -> float:
    """Return the predicted 3D RMS error in base of places 100 mm about a center, mapped by a pose.

    Args:
        T_base_tracker: The pose.
        covariance: Of its deviation (6, 6), as geometry/pose_covariance.py says.
        center_base: (3,)
    """
    arm = center_base - T_base_tracker.translation
    J = np.hstack((-cross_matrices(arm), np.eye(3)))
    at_center = float(np.trace(J @ covariance @ J.T))
    around = REACH_MM**2 * 2.0 / 3.0 * float(np.trace(covariance[:3, :3]))  # mean over directions
    return float(np.sqrt(at_center + around))


def judge_registration(
    tip_sigma_mm: float,
    registration_sigma_mm: float,
    marker_sigma_mm: float,
    used: Bools,
    rotations_base_tip: Floats,
) -> tuple[Literal["good", "weak", "bad"], tuple[str, ...]]:
    """Return the verdict and, where it is not good, the reasons with their remedies.

    Args:
        tip_sigma_mm: Predicted error of the tip.
        registration_sigma_mm: Predicted error of places near the tips, mapped to ``base``.
        marker_sigma_mm: Error of a single marker.
        used: (n,) False for gross errors.
        rotations_base_tip: Of the poses used.
    """
    reasons: list[str] = []
    worst = max(tip_sigma_mm, registration_sigma_mm)
    if worst > GOOD_MM:
        which = "tip" if tip_sigma_mm >= registration_sigma_mm else "registration"
        more = int(np.ceil(used.sum() * (worst / GOOD_MM) ** 2))
        reasons.append(
            f"the {which} is expected to be off by {worst:.2f} mm, {GOOD_MM} are good: pivot "
            f"further, or use about {more} poses"
        )
    second_deg = float(turns_deg(rotations_base_tip)[0][1])
    if second_deg < GOOD_TURN_DEG:
        reasons.append(
            f"the tool turned by only {second_deg:.1f} degrees (RMS) about its second axis: pivot "
            "over a wider cone"
        )
    rejected = len(used) - int(used.sum())
    if rejected > MAX_REJECTED * len(used):
        reasons.append(
            f"{rejected} of {len(used)} poses were gross errors: look for hidden or soiled "
            "markers and for reflections"
        )
    if marker_sigma_mm > NOISY_MM:
        reasons.append(
            f"single markers seem to be off by {marker_sigma_mm:.1f} mm: check the marker "
            "plate, its geometry file and that robot and tracker were read at the same time"
        )
    if worst > WEAK_MM:
        return "bad", tuple(reasons)
    return ("weak" if reasons else "good"), tuple(reasons)
