"""Tool registration from the recorded poses of robot and marker."""

from dataclasses import replace

import numpy as np

from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.references import TRACKER_FIELD, base_reference
from rona_core.app.dependencies.staleness import capture_input, result_input
from rona_core.app.steps.setup.capture_parts import MODEL, ROBOT_ERRORS
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.calibration.hand_eye.quality import registration_sigma_mm
from rona_core.calibration.hand_eye.robot_accuracy import (
    RegistrationSensitivity,
    check_robot_accuracy,
    registration_sensitivity,
)
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration, register_tool
from rona_core.calibration.timing.time_offset import TimeOffset, estimate_time_offset
from rona_core.calibration.tracking_error import LearnedField, TrackerErrorField
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.link_errors import ROBOT_ACCURACY_MM, link_errors
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.session.captures import ToolCapture
from rona_core.session.memo import remember

TOOL_CAPTURE: Input[ToolCapture] = capture_input("tool")
TOOL: Input[ToolRegistration] = result_input("tool")


@inputs(implied=("errors of the robot", "field of the tracker"))
class ToolInputs:
    """What tool, robot and tracker are registered from."""

    capture: ToolCapture = given(TOOL_CAPTURE, "capture")
    robot: str = given(MODEL, "robot")
    errors: bool = given(ROBOT_ERRORS, "errors of the robot")
    field: TrackerErrorField = given(TRACKER_FIELD, "field of the tracker")


SIGNIFICANT_SIGMAS = 3.0  # a smaller delay is not significant, and is not corrected
SETTLE_S = 0.1  # after the robot has stopped, before frames count


@remember(4)  # the poses, the result and the panels ask for it
def tracker_delay(capture: ToolCapture, model: RobotModel) -> TimeOffset | None:
    """Return how late the tracker is behind the robot; None where the motion does not tell.

    The robot's way of the tool marker is compared with the tracker's, each in its own frame.
    """
    Ts_base_toolmarker = model.forward(capture.joints.qs_rad) @ model.T_flange_toolmarker
    track = capture.marker
    try:
        return estimate_time_offset(
            capture.joints.times_s,
            Ts_base_toolmarker.translations,
            track.times_s,
            track.Ts_tracker_marker.translations,
        )
    except (InvalidInputError, DegenerateGeometryError):
        return None


def measured_times_s(capture: ToolCapture, model: RobotModel) -> Floats:
    """Return when the tracker measured each sample (k,) of its track, by the robot's clock."""
    delay, arrived_s = tracker_delay(capture, model), capture.marker.times_s
    if delay is None or abs(delay.offset_s) <= SIGNIFICANT_SIGMAS * delay.sigma_s:
        return arrived_s
    return arrived_s - delay.offset_s


def delay_words(delay: TimeOffset) -> tuple[str, str]:
    """Return who is behind whom and by how much, as people read it; a delay is never negative."""
    sigma_ms = max(1e3 * delay.sigma_s, 0.1)
    if abs(delay.offset_s) <= SIGNIFICANT_SIGMAS * delay.sigma_s:
        return "Robot-tracker latency", f"none, ± {sigma_ms:.1f} ms"
    words = f"{1e3 * abs(delay.offset_s):.1f} ± {sigma_ms:.1f} ms"
    late = "Tracker" if delay.offset_s > 0.0 else "Robot joint"
    return f"{late} latency (compensated)", words


def tool_poses(capture: ToolCapture, model: RobotModel) -> tuple[Poses, Poses, Ints]:
    """Return the poses of step 2 that were seen: by the robot, by the tracker, and their phases.

    Returns:
        ``Ts_base_tip``, ``Ts_tracker_toolmarker`` averaged over each dwell, phases (n,).

    Raises:
        DegenerateGeometryError: the marker was seen at none.
    """
    qs_rad, Ts_tracker_toolmarker, phases = tool_dwells(capture, model)
    return model.forward(qs_rad) @ model.T_flange_tip, Ts_tracker_toolmarker, phases


@remember(4)  # the registration, its sigmas and what is predicted by it ask for them
def tool_dwells(capture: ToolCapture, model: RobotModel) -> tuple[Floats, Poses, Ints]:
    """Return joint angles (n, 6), ``Ts_tracker_toolmarker`` and phases (n,) of the poses seen.

    Raises:
        DegenerateGeometryError: the marker was seen at none.
    """
    times, seen = measured_times_s(capture, model), capture.marker.Ts_tracker_marker
    kept, markers, joints = [], [], []
    for i, (start, end) in enumerate(zip(capture.dwell_start_s, capture.dwell_end_s, strict=True)):
        inside = (times >= start + SETTLE_S) & (times <= end)
        if inside.any():
            kept.append(i)
            markers.append(seen.select(inside).mean())
            joints.append(capture.joints.at(times[inside]).mean(axis=0))
    if not kept:
        raise DegenerateGeometryError(
            "the tracker saw the tool marker at none of the "
            f"{len(capture.phases)} poses: uncover it, or turn it towards the tracker"
        )
    return readonly(np.array(joints)), Poses.stack(markers), readonly(capture.phases[kept])


def _registered(known: ToolInputs, message: RegisterTool) -> ToolRegistration:
    """Average the tracker over each dwell of the robot and register tool, robot and tracker.

    Raises:
        InvalidInputError: a pose to be left out that there is not.
        DegenerateGeometryError: the marker was seen at too few poses, or they tell too little.
    """
    Ts_base_tip, Ts_tracker_toolmarker, phases = tool_poses(known.capture, robot_model(known.robot))
    return register_tool(
        Ts_base_tip,
        Ts_tracker_toolmarker,
        phases,
        method=message.method,
        exclude=excluded_mask(message.exclude, len(phases)),
    )


def _with_repeating_errors(known: ToolInputs, made: ToolRegistration) -> ToolRegistration:
    """Return the registration with what robot and tracker do the same every time in its sigmas."""
    moved_by, by_robot = repeating_parts(known.capture, known.robot, known.errors, made)
    field = LearnedField(known.field)
    by_tracker = field.propagate(moved_by.markers, moved_by.points_tracker)
    total = made.covariance + by_tracker + by_robot @ by_robot.T
    return replace(
        made,
        covariance=readonly((total + total.T) / 2.0),
        random_covariance=made.covariance,
        tip_sigma_mm=float(np.sqrt(np.trace(total[9:, 9:]))),
        registration_sigma_mm=registration_sigma_mm(
            made.T_base_tracker, total[:6, :6], moved_by.center_base
        ),
    )


@remember(4)
def repeating_parts(
    capture: ToolCapture, robot: str, errors: bool, made: ToolRegistration
) -> tuple[RegistrationSensitivity, Floats]:
    """Return how errors of markers and robot move a registration, and what the robot is stated for.

    The second (12, 36) times its transpose is the covariance by the robot.
    """
    model = robot_model(robot)
    qs_rad, seen, _ = tool_dwells(capture, model)
    moved_by = registration_sensitivity(made, model.forward(qs_rad) @ model.T_flange_tip, seen)
    accuracy_mm = ROBOT_ACCURACY_MM if errors else 0.0
    links = link_errors(model, qs_rad[made.used], model.T_flange_tip, accuracy_mm)
    by_robot = np.einsum("knj,njl->kl", moved_by.robot, links)
    of_tool = worse_half(by_robot[6:], by_robot[9:])
    return moved_by, readonly(np.concatenate((by_robot[:6], of_tool)))


def worse_half(tool: Floats, tip: Floats) -> Floats:
    """Return what links that are only shifted, or only turned, do to a tool.

    What is stated of a robot is the sum of both, which a registration feels alike. A tool feels the
    last link: its shift goes into the tip, its turn hardly does. As no source says how the sum is
    shared, all of it is taken to be what moves the tip more.

    Args:
        tool: What is wanted of it (k, 36), each half of the columns for half the variance.
        tip: Shifts of its tip (3, 36).
    """
    sizes = [float((half**2).sum()) for half in np.hsplit(tip, 2)]
    kept = np.repeat(np.array(sizes) >= max(sizes), tool.shape[1] // 2)
    return np.sqrt(2.0) * tool * kept


def _with_robot_check(known: ToolInputs, made: ToolRegistration) -> ToolRegistration:
    """Return the registration, not called good where it contradicts the robot's accuracy."""
    model = robot_model(known.robot)
    qs_rad, seen, _ = tool_dwells(known.capture, model)
    accuracy_mm = ROBOT_ACCURACY_MM if known.errors else 0.0
    links = link_errors(model, qs_rad, model.T_flange_tip, accuracy_mm)
    field = LearnedField(known.field)
    tips = model.forward(qs_rad) @ model.T_flange_tip
    check = check_robot_accuracy(made, tips, seen, links, field)
    if check is None or not check.contradicted:
        return made
    words = check.words(accuracy_mm, "the residuals of the registration")
    verdict = "bad" if made.verdict == "bad" else "weak"
    return replace(made, verdict=verdict, reasons=(*made.reasons, words))


def excluded_mask(rows: tuple[int, ...], n: int) -> Bools:
    """Return a mask (n,) of the poses that are left out by hand."""
    if rows and max(rows) >= n:
        raise InvalidInputError(f"there is no pose {max(rows)}: they are 0 to {n - 1}")
    mask = np.zeros(n, dtype=np.bool_)
    mask[list(rows)] = True
    return mask


def register(known: ToolInputs, message: RegisterTool) -> ToolRegistration:
    """Register robot, tool and tracker, with the place of the base marker and the delay.

    Raises:
        InvalidInputError: a pose to be left out that there is not.
        DegenerateGeometryError: the marker was seen at too few poses, or they tell too little.
    """
    made = _with_robot_check(known, _with_repeating_errors(known, _registered(known, message)))
    return replace(
        made,
        base=base_reference(known.capture.base, made.T_base_tracker),
        delay=tracker_delay(known.capture, robot_model(known.robot)),
    )
