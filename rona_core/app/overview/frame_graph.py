"""The frame graph of a session: its transforms, where they come from, and if they are stale."""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.app.dependencies.base_reference import placed_reason, reference_of
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.calibration.hand_eye.base_marker import point_sigmas_mm
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.devices.live import LiveState
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.captures import PointerCapture, is_imported
from rona_core.session.document import Session


@dataclass(frozen=True, slots=True, eq=False)
class FrameRow:
    """One edge of the graph: the pose of frame ``child`` in frame ``parent``, in mm."""

    parent: str
    child: str
    source: str  # step that made it, or "robot" (nominal), or "live"
    pose: Pose
    stale_reason: str | None = None  # None while it is up to date
    time_utc: str | None = None  # when it was measured or computed; None: nominal, or now
    sigma_mm: float | None = None  # predicted 3D error, of T_base_tracker at the skull
    sigma_deg: float | None = None  # predicted RMS of the whole turn

    @property
    def name(self) -> str:
        """Name of the transform, ``T_parent_child``."""
        return f"T_{self.parent}_{self.child}"

    @property
    def live(self) -> bool:
        """Whether a device reports it at this moment."""
        return self.source == "live"


def frame_rows(session: Session, live: LiveState | None = None) -> tuple[FrameRow, ...]:
    """Return the transforms that the session holds, and what the devices report now."""
    return (*_nominal(session), *_calibrated(session), *_reported(session, live or LiveState()))


def _nominal(session: Session) -> tuple[FrameRow, ...]:
    model = robot_model(session.setup.devices.robot.model)
    return (
        FrameRow("flange", "tip", "robot", model.T_flange_tip),
        FrameRow("flange", "probe", "robot", model.T_flange_probe),
        FrameRow("flange", "toolmarker", "robot", model.T_flange_toolmarker),
    )


def _calibrated(session: Session) -> tuple[FrameRow, ...]:
    results, rows = session.results, list[FrameRow]()
    if results.tool is not None:
        tool = results.tool.value
        turn_deg = _sigma_deg(tool.covariance[6:9, 6:9])
        tip = _made(session, "tool", ("toolmarker", "tip"), tool.T_toolmarker_tip)
        rows = [
            _tracker(session, tool),
            replace(tip, sigma_mm=tool.tip_sigma_mm, sigma_deg=turn_deg),
        ]
        if tool.base is not None:
            rows.append(_base_marker(session, tool, tool.base.T_base_basemarker))
    if results.pointer is not None:
        tip = Pose.from_translation(results.pointer.value.tip_pointermarker)
        row = _made(session, "pointer", ("pointermarker", "pointertip"), tip)
        rows.append(replace(row, sigma_mm=results.pointer.value.tip_sigma_mm))
    return tuple(rows)


def _made(session: Session, step: str, edge: tuple[str, str], pose: Pose) -> FrameRow:
    """Return an edge that a result made, without how sure it is."""
    return FrameRow(*edge, step, pose, stale_reason(step, session), _made_utc(session, step))


def _base_marker(session: Session, tool: ToolRegistration, pose: Pose) -> FrameRow:
    covariance = tool.covariance[:6, :6]
    sigma_mm = point_sigmas_mm(tool.T_base_tracker, covariance, pose.translation[None])[0]
    row = _made(session, "tool", ("base", "basemarker"), pose)
    return replace(row, sigma_mm=float(sigma_mm), sigma_deg=_sigma_deg(covariance[:3, :3]))


def _tracker(session: Session, tool: ToolRegistration) -> FrameRow:
    """Return the tracker in ``base``: as registered, or as the newest stroke found it again."""
    row = _made(session, "tool", ("base", "tracker"), tool.T_base_tracker)
    covariance, reason = tool.covariance[:6, :6], row.stale_reason
    stroke = None if reason is not None else _newest_stroke(session)
    if stroke is not None:
        try:
            found = reference_of(session, stroke)
        except RonaError as error:
            reason = str(error)
        else:
            if found.state == "carried":
                covariance, made_utc = found.covariance, captured_utc(session, stroke.ordinal)
                pose = found.T_base_tracker
                row = replace(row, source="tool, base marker", pose=pose, time_utc=made_utc)
    return replace(
        row,
        stale_reason=reason or placed_reason(session) or _moved_since(session, stroke),
        sigma_mm=_skull_sigma_mm(session, tool, row.pose, covariance),
        sigma_deg=_sigma_deg(covariance[:3, :3]),
    )


def _skull_sigma_mm(
    session: Session, tool: ToolRegistration, T_base_tracker: Pose, covariance: Floats
) -> float:
    """Return the predicted error at the skull; before it was touched, about the tool's poses."""
    surface = session.results.surface
    if surface is None:
        return tool.registration_sigma_mm
    center = surface.value.points_base.mean(axis=0)
    return float(point_sigmas_mm(T_base_tracker, covariance, center[None])[0])


def _newest_stroke(session: Session) -> PointerCapture | None:
    """Return the newest stroke since the registration was recorded, imports left out."""
    held, since = session.captures, session.captures.tool
    strokes = [*held.surface, *(() if held.path is None else (held.path,))]
    first = 0 if since is None else since.ordinal
    known = [s for s in strokes if s.ordinal > first and not is_imported(s)]
    return max(known, key=lambda stroke: stroke.ordinal, default=None)


def _moved_since(session: Session, stroke: PointerCapture | None) -> str | None:
    """Return that the tracker was moved since it was seen last, None if it was not."""
    seen = session.captures.tool if stroke is None else stroke
    if seen is None or seen.tracker_place == session.setup.devices.tracker.place:
        return None
    return "the tracker was moved: the next stroke finds it again by the base marker"


def _made_utc(session: Session, result: str) -> str | None:
    """Return when a result was computed, by the log."""
    made = session.results.get(result)
    for entry in reversed(session.log):
        if made and (entry.message, entry.arguments) == (made.message, made.arguments):
            return entry.time_utc
    return None


def captured_utc(session: Session, ordinal: int) -> str | None:
    """Return when a capture was stored, by the log."""
    for entry in reversed(session.log):
        capture = entry.arguments.get("capture")
        if isinstance(capture, dict) and capture.get("ordinal") == ordinal:
            return entry.time_utc
    return None


def _sigma_deg(covariance: Floats) -> float:
    return float(np.rad2deg(np.sqrt(np.trace(covariance))))


def _reported(session: Session, live: LiveState) -> tuple[FrameRow, ...]:
    rows: list[FrameRow] = []
    if live.joints is not None:
        model = robot_model(session.setup.devices.robot.model)
        T_base_flange = model.forward(np.asarray(live.joints.q_rad)[None])[0]
        rows.append(FrameRow("base", "flange", "live", T_base_flange))
    pointer = session.setup.devices.pointer
    for sample in live.frame.tools if live.frame is not None else ():
        known = sample.tool in ("toolmarker", "basemarker", pointer)
        if sample.T_tracker_marker is not None and known:
            child = "pointermarker" if sample.tool == pointer else sample.tool
            rows.append(FrameRow("tracker", child, "live", sample.T_tracker_marker))
    return tuple(rows)
