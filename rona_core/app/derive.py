"""Compute each result from the captures of a session: pure, so a replay gives the same bits."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from rona_core.app.messages import (
    BuildPath,
    BuildSurface,
    CalibratePointer,
    RegisterTool,
    SmoothScanPath,
    StartMapping,
    StartRollSearch,
)
from rona_core.arrays import Floats, Vector3
from rona_core.calibration.pointer import PointerCalibration, calibrate_pointer
from rona_core.calibration.tool import ToolRegistration, register_tool
from rona_core.devices.markers import GEOMETRIES
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import DegenerateGeometryError, StepBlockedError
from rona_core.geometry.pose import Poses
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.build import build_maps
from rona_core.path.filter import filter_path
from rona_core.path.interpolate import densify
from rona_core.path.smooth import simplify
from rona_core.robot.model import robot_model
from rona_core.robot.plan import RobotPlan
from rona_core.robot.scan_plan import PlanSettings, choose_roll, plan_scan
from rona_core.robot.timing import ScanSettings
from rona_core.session.document import PointerCapture, RawPath, Session, SmoothPath
from rona_core.surface.cloud import SurfaceCloud, build_cloud, merge_clouds
from rona_core.surface.normals import NormalField
from rona_core.ultrasound.detect import Detection, detect
from rona_core.ultrasound.probe import probe_model

SETTLE_S = 0.1  # after the robot has stopped, before frames count
T = Any


def never() -> bool:
    """Nobody cancels."""
    return False


def silent(_: float) -> None:
    """Nobody watches the progress."""


def _need(value: Any, wanted: str) -> Any:
    if value in (None, ()):
        raise StepBlockedError(f"first {wanted}")
    return value


def derive_tool(session: Session, message: RegisterTool) -> ToolRegistration:
    """Average the tracker over each dwell of the robot and register tool, robot and tracker.

    Raises:
        DegenerateGeometryError: the marker was seen at too few poses, or they tell too little.
    """
    capture = _need(session.captures.tool, "record the tool motion")
    model = robot_model(session.setup.devices.robot.model)
    times, seen = capture.marker.times_s, capture.marker.Ts_tracker_marker
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
    return register_tool(
        Ts_base_tip, Poses.stack(markers), capture.phases[kept], method=message.method
    )


def derive_pointer(session: Session, message: CalibratePointer) -> PointerCalibration:
    """Calibrate the pointer from its pivoting."""
    capture = _need(session.captures.pointer, "record the pivoting of the pointer")
    return calibrate_pointer(
        capture.marker.Ts_tracker_marker,
        pointer=capture.pointer,
        dof=GEOMETRIES[capture.pointer].dof,
        method=message.method,
    )


def tip_track(session: Session, capture: PointerCapture) -> Floats:
    """Return the pointer tip (k, 3) in ``base`` for every frame in which the pointer was seen.

    Raises:
        StepBlockedError: tool or pointer are not calibrated, or it was another pointer.
    """
    tool = _need(session.results.tool, "register the tool").value
    pointer = _need(session.results.pointer, "calibrate the pointer").value
    if pointer.pointer != capture.pointer:
        raise StepBlockedError(
            f"the stroke was made with {capture.pointer}, but {pointer.pointer} is calibrated: "
            f"calibrate {capture.pointer} or record the stroke again"
        )
    tips_tracker = capture.marker.Ts_tracker_marker @ pointer.tip_pointermarker
    return tool.T_base_tracker @ tips_tracker


def derive_surface(session: Session, message: BuildSurface) -> SurfaceCloud:
    """Map all strokes to ``base`` and build the cloud.

    Raises:
        DegenerateGeometryError: the pointer was seen in none of the frames.
    """
    strokes = _need(session.captures.surface, "slide the pointer over the skull")
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
    capture = _need(session.captures.path, "demonstrate the scan path")
    points_base = tip_track(session, capture)
    if len(points_base) < 2:
        raise DegenerateGeometryError(
            f"the tracker saw the pointer in {len(points_base)} frames of the demonstration, "
            "2 are the least: uncover the pointer"
        )
    return RawPath(points_base)


def _viewpoint_base(session: Session) -> Vector3:
    """Return where the pointer's markers were while it drew: the side the probe comes from."""
    capture = _need(session.captures.path, "demonstrate the scan path")
    tool = _need(session.results.tool, "register the tool").value
    return tool.T_base_tracker @ capture.marker.Ts_tracker_marker.translations.mean(axis=0)


def derive_smoothing(session: Session, message: SmoothScanPath) -> SmoothPath:
    """Filter and thin the path, find normals in the cloud and interpolate densely.

    Raises:
        DegenerateGeometryError: the cloud is too thin around a path point.
    """
    path = _need(session.results.path, "demonstrate the scan path").value
    cloud = _need(session.results.surface, "sample the surface").value
    capture = _need(session.captures.path, "demonstrate the scan path")
    points, times = path.points_base, capture.marker.times_s
    if message.filter_s > 0:
        points = filter_path(points, times, sigma_s=message.filter_s)
    simplified = simplify(
        points, message.tolerance_mm, method=message.method, metric=message.metric
    )
    corners = points[simplified.index]
    field = NormalField(np.vstack((cloud.points_base, points)), message.normal_radius_mm)
    normals = field.normals(
        corners, method=message.normal_method, viewpoint=_viewpoint_base(session)
    )
    if not normals.ok.all():
        bad = np.flatnonzero(~normals.ok)
        raise DegenerateGeometryError(
            f"{len(bad)} of {len(corners)} path points have no reliable normal (the first is "
            f"point {bad[0]} with {normals.count[bad[0]]} samples within "
            f"{message.normal_radius_mm:g} mm): sample the surface there or enlarge the radius"
        )
    return SmoothPath(simplified, normals, densify(corners, -normals.normals))


def derive_roll(
    session: Session,
    message: StartRollSearch,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RobotPlan:
    """Judge every roll, and plan, time and verify the scan with the chosen one."""
    smooth = _need(session.results.smoothing, "smooth the path").value
    return plan_scan(
        smooth.path,
        robot_model(session.setup.devices.robot.model),
        plan_settings(session, message),
        progress=progress,
        cancel=cancel,
    )


def plan_settings(session: Session, message: StartRollSearch) -> PlanSettings:
    """Return how to search and drive, from what was asked for and the robot's settings."""
    return PlanSettings(
        n_rolls=message.n_rolls,
        roll_from_deg=message.roll_from_deg,
        roll_to_deg=message.roll_to_deg,
        choice=message.choice,
        scan=ScanSettings(scan_speed_mm_per_s=session.setup.devices.robot.scan_speed_mm_per_s),
    )


def derive_chosen_roll(session: Session, plan: RobotPlan, index: int) -> RobotPlan:
    """Plan, time and verify the scan with another roll of a search.

    Raises:
        NotReachableError: the path cannot be followed with this roll; it says why.
    """
    model = robot_model(session.setup.devices.robot.model)
    return choose_roll(plan, index, model, plan_settings(session, StartRollSearch()))


def derive_detection(
    session: Session,
    message: StartMapping,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Detection:
    """Find both boundaries in every A-scan."""
    capture = _need(session.captures.scan, "scan")
    probe = session.setup.devices.probe
    return detect(
        capture.scans,
        probe_model(probe.name),
        probe.excitation,
        method=message.method,
        sound_speed_mm_per_us=message.sound_speed_mm_per_us,
        progress=progress,
        cancel=cancel,
    )


def probe_poses(session: Session) -> Poses:
    """Return the pose of the probe in ``base`` at each A-scan, from the robot's joint angles."""
    capture = _need(session.captures.scan, "scan")
    model = robot_model(session.setup.devices.robot.model)
    return model.forward(capture.joints.at(capture.scans.times_s)) @ model.T_flange_probe


def derive_maps(
    session: Session,
    message: StartMapping,
    detection: Detection,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Maps:
    """Map both boundaries and fuse the outer one with the pointer cloud."""
    cloud = _need(session.results.surface, "sample the surface").value
    return build_maps(
        detection,
        probe_poses(session),
        cloud.points_base,
        cell_mm=message.cell_mm,
        progress=progress,
        cancel=cancel,
    )


@dataclass(frozen=True, slots=True)
class Mapped:
    """Both results of step 9."""

    detection: Detection
    maps: Maps


def derive_mapping(
    session: Session,
    message: StartMapping,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Mapped:
    """Detect the boundaries, then map them."""
    found = derive_detection(session, message, progress=lambda p: progress(0.7 * p), cancel=cancel)
    maps = derive_maps(
        session, message, found, progress=lambda p: progress(0.7 + 0.3 * p), cancel=cancel
    )
    return Mapped(found, maps)


def lean(session: Session) -> Session:
    """Return the session without what no computation needs, to send it to another process."""
    return replace(session, archive=(), log=())


# command -> result it makes and the function that does it
SHORT: dict[type, tuple[str, Callable[[Session, Any], Any]]] = {
    RegisterTool: ("tool", derive_tool),
    CalibratePointer: ("pointer", derive_pointer),
    BuildSurface: ("surface", derive_surface),
    BuildPath: ("path", derive_path),
    SmoothScanPath: ("smoothing", derive_smoothing),
}


def arguments_of(message: Any) -> dict[str, object]:
    """Return the fields of a command or activity."""
    return {field.name: getattr(message, field.name) for field in fields(message)}
