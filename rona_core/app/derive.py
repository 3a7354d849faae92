"""Compute each result from the captures of a session: pure, so a replay gives the same bits."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.dependencies.base_reference import base_reference, reference_of
from rona_core.app.dependencies.inputs import need
from rona_core.app.messages.registry import (
    BuildPath,
    BuildSurface,
    CalibrateDelayLine,
    CalibrateHandheldProbe,
    CalibratePointer,
    CalibrateSoundSpeed,
    GenerateScanPattern,
    RegisterTool,
    SmoothScanPath,
)
from rona_core.app.steps.acoustics.derivation import derive_line, derive_speed
from rona_core.app.steps.smoothing.derivation import derive_pattern, derive_smoothing
from rona_core.app.steps.tool.tracker_delay import measured_times_s, tracker_delay
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration, register_tool
from rona_core.calibration.handheld.pointer import PointerCalibration, calibrate_pointer
from rona_core.calibration.handheld.tracked_probe import SonoCalibration, calibrate_sono
from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.devices.settings import SONO
from rona_core.errors import DegenerateGeometryError, InvalidInputError, StepBlockedError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import PointerCapture, RawPath, Session
from rona_core.surface.cloud import SurfaceCloud, build_cloud, merge_clouds

SETTLE_S = 0.1  # after the robot has stopped, before frames count


def tool_poses(session: Session) -> tuple[Poses, Poses, Ints]:
    """Return the poses of step 2 that were seen: by the robot, by the tracker, and their phases.

    Returns:
        ``Ts_base_tip``, ``Ts_tracker_toolmarker`` averaged over each dwell, phases (n,).

    Raises:
        DegenerateGeometryError: the marker was seen at none.
    """
    capture = need(session.captures.tool, "record the tool motion")
    model = robot_model(session.setup.devices.robot.model)
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
    Ts_base_tip = model.forward(np.array(joints)) @ model.T_flange_tip
    return Ts_base_tip, Poses.stack(markers), capture.phases[kept]


def derive_tool(session: Session, message: RegisterTool) -> ToolRegistration:
    """Average the tracker over each dwell of the robot and register tool, robot and tracker.

    Raises:
        InvalidInputError: a pose to be left out that there is not.
        DegenerateGeometryError: the marker was seen at too few poses, or they tell too little.
    """
    Ts_base_tip, Ts_tracker_toolmarker, phases = tool_poses(session)
    return register_tool(
        Ts_base_tip,
        Ts_tracker_toolmarker,
        phases,
        method=message.method,
        exclude=_left_out(message.exclude, len(phases)),
    )


def _left_out(rows: tuple[int, ...], n: int) -> Bools:
    """Return a mask (n,) of the poses that are left out by hand."""
    if rows and max(rows) >= n:
        raise InvalidInputError(f"there is no pose {max(rows)}: they are 0 to {n - 1}")
    mask = np.zeros(n, dtype=np.bool_)
    mask[list(rows)] = True
    return mask


def derive_pointer(session: Session, message: CalibratePointer) -> PointerCalibration:
    """Calibrate the pointer from its pivoting.

    Raises:
        InvalidInputError: too few poses, or one to be left out that there is not.
        DegenerateGeometryError: they tell too little.
    """
    capture = need(session.captures.pointer, "record the pivoting of the pointer")
    geometry = GEOMETRIES[capture.pointer]
    return calibrate_pointer(
        capture.marker.Ts_tracker_marker,
        pointer=capture.pointer,
        dof=geometry.dof,
        method=message.method,
        positions_pointermarker=geometry.positions_marker,
        exclude=_left_out(message.exclude, len(capture.marker.times_s)),
    )


def derive_sono(session: Session, message: CalibrateHandheldProbe) -> SonoCalibration:
    """Calibrate the probe in the hand from its pivoting and its turning.

    Raises:
        InvalidInputError: the tracker saw it in too few frames.
        DegenerateGeometryError: the motions tell too little.
    """
    pivot = need(session.captures.sono_pivot, "pivot the SonoPointer")
    spin = need(session.captures.sono_spin, "turn the SonoPointer about its axis")
    return calibrate_sono(
        pivot.marker.Ts_tracker_marker,
        spin.marker.Ts_tracker_marker,
        pointer=SONO,
        positions_marker=GEOMETRIES[SONO].positions_marker,
    )


def derive_registration(session: Session, message: RegisterTool) -> ToolRegistration:
    """Register robot, tool and tracker; remember where the base marker was, and the delay."""
    made = derive_tool(session, message)
    capture = need(session.captures.tool, "record the tool motion")
    return replace(
        made,
        base=base_reference(capture.base, made.T_base_tracker),
        delay=tracker_delay(capture, robot_model(session.setup.devices.robot.model)),
    )


def tip_track(session: Session, capture: PointerCapture) -> Floats:
    """Return the pointer tip (k, 3) in ``base`` for every frame in which the pointer was seen.

    Raises:
        StepBlockedError: tool or pointer are not calibrated, or it was another pointer.
        StaleResultError: the tracker has moved since the registration, and is not found again.
    """
    reference = reference_of(session, capture)
    pointer = need(session.results.pointer, "calibrate the pointer").value
    if pointer.pointer != capture.pointer:
        raise StepBlockedError(
            f"the stroke was made with {capture.pointer}, but {pointer.pointer} is calibrated: "
            f"calibrate {capture.pointer} or record the stroke again"
        )
    tips_tracker = capture.marker.Ts_tracker_marker @ pointer.tip_pointermarker
    return reference.T_base_tracker @ tips_tracker


def derive_surface(session: Session, message: BuildSurface) -> SurfaceCloud:
    """Map all strokes to ``base`` and build the cloud.

    Raises:
        DegenerateGeometryError: the pointer was seen in none of the frames.
    """
    strokes = need(session.captures.surface, "slide the pointer over the skull")
    clouds = [
        build_cloud(tip_track(session, s), s.marker.times_s, average_s=message.average_s)
        for s in strokes
        if len(s.marker.times_s)
    ]
    if not clouds:
        raise DegenerateGeometryError("the tracker saw the pointer in no frame of the strokes")
    return merge_clouds(clouds)


def derive_path(session: Session, message: BuildPath) -> RawPath:
    """Map the demonstrated stroke to ``base``.

    Raises:
        DegenerateGeometryError: the pointer was seen in fewer than two frames.
    """
    capture = need(session.captures.path, "demonstrate the scan path")
    points_base = tip_track(session, capture)
    if len(points_base) < 2:
        raise DegenerateGeometryError(
            f"the tracker saw the pointer in {len(points_base)} frames of the demonstration, "
            "2 are the least: uncover the pointer"
        )
    return RawPath(points_base)


# command -> result it makes and the function that does it
SHORT: dict[type, tuple[str, Callable[[Session, Any], Any]]] = {
    RegisterTool: ("tool", derive_registration),
    CalibratePointer: ("pointer", derive_pointer),
    CalibrateHandheldProbe: ("sono", derive_sono),
    BuildSurface: ("surface", derive_surface),
    BuildPath: ("path", derive_path),
    GenerateScanPattern: ("path", derive_pattern),
    SmoothScanPath: ("smoothing", derive_smoothing),
    CalibrateSoundSpeed: ("speed", derive_speed),
    CalibrateDelayLine: ("line", derive_line),
}
