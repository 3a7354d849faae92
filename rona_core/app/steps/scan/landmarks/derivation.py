"""Landmarks by tracker and pointer against those of the robot, with the predicted covariance."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.steps.pointer.derivation import repeating_errors
from rona_core.app.steps.scan.landmarks.capture import LandmarkInputs, OverrideInputs
from rona_core.app.steps.scan.landmarks.messages import OverrideLandmarks, VerifyLandmarks
from rona_core.calibration.error_propagation import pose_covariance
from rona_core.calibration.hand_eye.robot_accuracy import score_of_links
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.landmark_check import LandmarkCheck, require_enough
from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.devices.settings import POINTERS
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import StepBlockedError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.pose import Poses
from rona_core.geometry.pose_covariance import point_jacobians
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.link_errors import ROBOT_ACCURACY_MM, link_errors

SEAT_MM = 0.1  # 3D RMS of a tip in a divot: of the robot's tip, and of the pointer's
MIN_SIGMA_MM = 1e-3  # of a marker, where a perfect tracker leaves no scatter


@dataclass(frozen=True, slots=True)
class LandmarkOverride:
    """The decision that the robot may scan without a verification that passed."""

    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Touched:
    """The pointer on the landmarks where it was seen."""

    poses: Poses  # (k,) of its marker in ``tracker``, the mean of each
    frames: Ints  # (k,) that each is the mean of


def compare_landmarks(known: LandmarkInputs, message: VerifyLandmarks) -> LandmarkCheck:
    """Compare the landmarks, and predict how far apart they should be.

    Raises:
        StepBlockedError: the pointer on them is another one.
        StaleResultError: the tracker has moved since the registration, and is not found again.
        DegenerateGeometryError: the pointer was seen on too few of them.
    """
    capture, pointer = known.capture, known.pointer
    if pointer.pointer != capture.stroke.pointer:
        raise StepBlockedError(
            f"the landmarks were touched with the {POINTERS[capture.stroke.pointer]}, but the "
            f"{POINTERS[pointer.pointer]} is calibrated: verify again"
        )
    reference = known.registered.reference(capture.stroke)
    model = robot_model(known.evidence.robot)
    robot_base = (model.forward(capture.qs_rad) @ model.T_flange_tip).translations
    times_s, track = capture.stroke.marker.times_s, capture.stroke.marker.Ts_tracker_marker
    inside = [
        (times_s >= start) & (times_s <= end)
        for start, end in zip(capture.dwell_start_s, capture.dwell_end_s, strict=True)
    ]
    frames = np.array([int(rows.sum()) for rows in inside])
    seen = frames > 0
    require_enough(seen)
    touched = Touched(
        Poses.stack([track.select(rows).mean() for rows in inside if rows.any()]), frames[seen]
    )
    pointer_base = np.array(robot_base)
    pointer_base[seen] = reference.T_base_tracker @ (touched.poses @ pointer.tip_pointermarker)
    rest, links = _expected(known, capture.qs_rad[seen], touched)
    rest = rest + reference.added_mm**2 / 3.0 * np.eye(len(rest))
    variances = (rest + links @ links.T).diagonal().reshape(-1, 3).sum(axis=1)
    sigmas_mm = np.zeros(len(seen))
    sigmas_mm[seen] = np.sqrt(variances)
    return LandmarkCheck(
        names=capture.names,
        robot_base=readonly(robot_base),
        pointer_base=readonly(pointer_base),
        seen=readonly(seen),
        sigmas_mm=readonly(sigmas_mm),
        sigmas=message.sigmas,
        limit_mm=message.limit_mm,
        contradiction=_contradiction((pointer_base - robot_base)[seen], links, rest),
    )


def override(known: OverrideInputs, message: OverrideLandmarks) -> LandmarkOverride:
    """Keep why the robot may scan without a verification that passed."""
    return LandmarkOverride(message.reason.strip())


def _contradiction(apart_base: Floats, links: Floats, rest: Floats) -> str:
    """Return why distances (k, 3) contradict the robot's accuracy; empty where they do not."""
    if not links.any():
        return ""
    test = score_of_links(apart_base.ravel(), links, rest)
    if not test.contradicted:
        return ""
    return test.words(ROBOT_ACCURACY_MM, "the distances of the landmarks")


def _expected(known: LandmarkInputs, qs_rad: Floats, touched: Touched) -> tuple[Floats, Floats]:
    """Return what is expected of pointer less robot at the landmarks.

    What the links of the robot do to the registration and to the touched postures goes together
    and cancels for the most part.

    Returns:
        The covariance (3 k, 3 k) without that of the links, in mm^2, and the distances in ``base``
        (3 k, m) by m independent standard normal errors of the links.
    """
    k, poses, evidence = len(touched.poses), touched.poses, known.evidence
    tool, pointer = known.registered.tool, known.pointer
    R_base_marker = tool.T_base_tracker.rotation @ poses.rotations
    J = point_jacobians(tool.T_base_tracker, poses @ pointer.tip_pointermarker).reshape(3 * k, 6)
    turns = R_base_marker.reshape(3 * k, 3)
    repeating = repeating_errors(evidence, tool, pointer, poses)
    model = robot_model(evidence.robot)
    accuracy_mm = ROBOT_ACCURACY_MM if evidence.errors else 0.0
    links = repeating.links
    if links.shape[1] == 36 and accuracy_mm > 0.0:
        links = links + link_errors(model, qs_rad, model.T_flange_tip, accuracy_mm)[:, 3:].reshape(
            3 * k, 36
        )
    random, tip = repeating.registration[:6, :6], repeating.tip
    joint = repeating.tracker + J @ random @ J.T + turns @ tip @ turns.T
    return joint + _own(touched, tool, pointer), links


def _own(touched: Touched, tool: ToolRegistration, pointer: PointerCalibration) -> Floats:
    """Return the part (3 k, 3 k) of each landmark alone: its frames, and how both tips sit."""
    k, R_base_tracker = len(touched.poses), tool.T_base_tracker.rotation
    noise = MarkerNoise(sigma_mm=max(pointer.marker_sigma_mm or tool.marker_sigma_mm, MIN_SIGMA_MM))
    positions = GEOMETRIES[pointer.pointer].positions_marker
    own = np.zeros((k, 3, k, 3))
    for i, (T_tracker_marker, n) in enumerate(zip(touched.poses, touched.frames, strict=True)):
        tip = pointer.tip_pointermarker[None]
        J = R_base_tracker @ point_jacobians(T_tracker_marker, tip)[0]
        frame = J @ pose_covariance(T_tracker_marker, positions, noise, int(n)) @ J.T
        own[i, :, i] = frame + 2.0 * SEAT_MM**2 / 3.0 * np.eye(3)
    return own.reshape(3 * k, 3 * k)
