"""Calibration of the pointer from its pivoting, and errors of the places that it touched.

Errors of the places that a pointer touched, all together: what they share and what they do not. A
touched place is off by the registration, the calibrated tip and its own frames. What tracker and
robot do the same every time is in all three: the tracker errs at the surface nearly as it did at
the registration, and that part cancels. So all markers that were ever seen stand in one covariance.
"""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.references import TRACKER_FIELD
from rona_core.app.dependencies.staleness import capture_input, made_of, result_input
from rona_core.app.steps.pointer.messages import CalibratePointer
from rona_core.app.steps.pointer.pivot_report import calibrate_imported
from rona_core.app.steps.setup.capture_parts import MODEL, ROBOT_ERRORS
from rona_core.app.steps.tool.derivation import excluded_mask, repeating_parts
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration, calibrate_pointer
from rona_core.calibration.pivot.maximum_likelihood import (
    PivotMotion,
    field_of_pivot,
    tip_sensitivity,
)
from rona_core.calibration.tracking_error import LearnedField, TrackerErrorField, fit_matrices
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Poses
from rona_core.geometry.pose_covariance import cross_matrices, point_jacobians
from rona_core.session.captures import PointerCapture, ToolCapture, is_imported
from rona_core.session.memo import remember


def with_tracker_field(
    made: PointerCalibration, capture: PointerCapture, stated: TrackerErrorField
) -> PointerCalibration:
    """Return the calibration with what the tracker does the same every time in its sigma."""
    motion = pivot_motion(made, capture)
    moved_by = tip_sensitivity(motion)
    by_tracker = learned_field(made, capture, stated).propagate(
        moved_by.tip, moved_by.points_tracker
    )
    total = made.tip_covariance_pointermarker + by_tracker
    return replace(
        made,
        tip_covariance_pointermarker=readonly((total + total.T) / 2.0),
        random_covariance=made.tip_covariance_pointermarker,
        tip_sigma_mm=float(np.sqrt(np.trace(total))),
    )


@remember(4)
def learned_field(
    made: PointerCalibration, capture: PointerCapture, stated: TrackerErrorField
) -> LearnedField:
    """Return the field of the tracker with the lengths that the pivot makes likely."""
    return field_of_pivot(pivot_motion(made, capture), LearnedField(stated))


def pivot_motion(made: PointerCalibration, capture: PointerCapture) -> PivotMotion:
    """Return the poses of a pivot that count, and what was found of it."""
    return PivotMotion(
        capture.marker.Ts_tracker_marker.select(made.used),
        GEOMETRIES[made.pointer].positions_marker,
        made.dof,
        made.tip_pointermarker,
        made.pivot_tracker,
    )


@dataclass(frozen=True, slots=True)
class Evidence:
    """Robot and tracker, and the captures that calibrations were made of; None: of earlier ones."""

    robot: str  # its model
    errors: bool  # whether the robot errs
    field: TrackerErrorField
    tool: ToolCapture | None
    pointer: PointerCapture | None


@dataclass(frozen=True, slots=True, eq=False)
class Repeating:
    """Covariances (3 n, 3 n) in ``base`` of n touched places by what repeats, in mm^2.

    With them what is left of both calibrations: chance, or all where their captures are gone.
    """

    tracker: Floats
    links: Floats  # (3 n, m) by m independent standard normal errors of the robot's links, in mm
    registration: Floats  # (12, 12) of the registration, as its calibration orders it
    tip: Floats  # (3, 3) of the pointer's tip in its marker

    @property
    def robot(self) -> Floats:
        """What the robot does the same every time."""
        return self.links @ self.links.T


def repeating_errors(
    evidence: Evidence, tool: ToolRegistration, pointer: PointerCalibration, poses: Poses
) -> Repeating:
    """Return what tracker and robot do the same every time to places that were touched.

    Without the capture of a calibration its own part is not known apart from chance, and is left
    to the covariance that the calibration states.

    Args:
        evidence: Robot, tracker, and the captures of both calibrations.
        tool: Registration of the tracker.
        pointer: Calibration of the pointer.
        poses: Of the pointer's markers in ``tracker`` (n,), at the places.
    """
    n = len(poses)
    J = point_jacobians(tool.T_base_tracker, poses @ pointer.tip_pointermarker)
    R_base_tracker = tool.T_base_tracker.rotation
    stated = evidence.field
    field, robot = LearnedField(stated), np.zeros((3 * n, 1))
    registration, tip = tool.covariance, pointer.tip_covariance_pointermarker
    parts = [_at_frames(pointer, poses, R_base_tracker)]
    if evidence.tool is not None and tool.random_covariance is not None:
        registration = tool.random_covariance
        moved_by, by_robot = repeating_parts(evidence.tool, evidence.robot, evidence.errors, tool)
        robot = (J @ by_robot[:6]).reshape(3 * n, -1)
        parts.append((np.einsum("nik,kpl->nipl", J, moved_by.markers[:6]), moved_by.points_tracker))
    if evidence.pointer is not None and pointer.random_covariance is not None:
        tip, field = pointer.random_covariance, learned_field(pointer, evidence.pointer, stated)
        moved = tip_sensitivity(pivot_motion(pointer, evidence.pointer))
        R_base_marker = R_base_tracker @ poses.rotations
        parts.append((np.einsum("nij,jpl->nipl", R_base_marker, moved.tip), moved.points_tracker))
    by_markers = np.concatenate([part for part, _ in parts], axis=2)
    points = np.concatenate([points for _, points in parts])
    parts.clear()  # there is no room for both
    return Repeating(
        tracker=readonly(field.propagate(by_markers.reshape(3 * n, -1, 3), points)),
        links=readonly(robot),
        registration=registration,
        tip=tip,
    )


def _at_frames(
    pointer: PointerCalibration, poses: Poses, R_base_tracker: Floats
) -> tuple[Floats, Floats]:
    """Return how n tips (n, 3, n m, 3) move with the markers of their own frame, and these."""
    positions = GEOMETRIES[pointer.pointer].positions_marker
    n, m = len(poses), len(positions)
    lever = poses.rotations @ (pointer.tip_pointermarker - positions.mean(axis=0))
    upright = np.broadcast_to(np.eye(3), (n, 3, 3))
    turned = np.concatenate((-cross_matrices(lever), upright), axis=2)
    own = R_base_tracker @ turned[:, None] @ fit_matrices(poses.rotations, positions)
    moved = np.zeros((n, 3, n, m, 3))
    moved[np.arange(n), :, np.arange(n)] = np.swapaxes(own, 1, 2)
    return moved.reshape(n, 3, n * m, 3), poses.map_points(positions).reshape(-1, 3)


POINTER_CAPTURE: Input[PointerCapture] = capture_input("pointer")
POINTER: Input[PointerCalibration] = result_input("pointer")
_OF_TOOL: Input[ToolCapture] = Input(
    lambda s: s.captures.tool if made_of(s.results.tool, "capture", s.captures.tool) else None,
    "register the tool (step 2)",
    optional=True,
    part="capture tool",
)
_OF_POINTER: Input[PointerCapture] = Input(
    lambda s: (
        s.captures.pointer if made_of(s.results.pointer, "capture", s.captures.pointer) else None
    ),
    "calibrate the pointer (step 3)",
    optional=True,
    part="capture pointer",
)
EVIDENCE: Quantity[Evidence] = Quantity(
    Evidence,
    {
        "robot": MODEL,
        "errors of the robot": ROBOT_ERRORS,
        "field of the tracker": TRACKER_FIELD,
        "capture of the tool": _OF_TOOL,
        "capture of the pointer": _OF_POINTER,
    },
)


@inputs(implied=("field of the tracker",))
class PointerInputs:
    """What the tip of the pointer is calibrated from."""

    capture: PointerCapture = given(POINTER_CAPTURE, "capture")
    field: TrackerErrorField = given(TRACKER_FIELD, "field of the tracker")


def calibrate(known: PointerInputs, message: CalibratePointer) -> PointerCalibration:
    """Calibrate the pointer from its pivoting.

    Raises:
        InvalidInputError: too few poses, or one to be left out that there is not.
        DegenerateGeometryError: they tell too little.
    """
    capture = known.capture
    geometry = GEOMETRIES[capture.pointer]
    exclude = excluded_mask(message.exclude, len(capture.marker.times_s))
    if is_imported(capture):
        made = calibrate_imported(capture, method=message.method, exclude=exclude)
    else:
        made = calibrate_pointer(
            capture.marker.Ts_tracker_marker,
            pointer=capture.pointer,
            dof=geometry.dof,
            method=message.method,
            positions_pointermarker=geometry.positions_marker,
            exclude=exclude,
        )
    return with_tracker_field(made, capture, known.field)
