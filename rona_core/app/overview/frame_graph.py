"""The frame graph of a session: its transforms, where they come from, and if they are stale."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rona_core.app.dependencies.base_reference import TrackerReference, placed_reason, reference_of
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.calibration.hand_eye.base_marker import point_sigmas_mm
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.devices.live import LiveState
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Derived, Session
from rona_core.session.imported import is_imported


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
    rows: list[FrameRow] = []
    if session.results.tool is not None:
        rows += _registered(session, session.results.tool)
    if session.results.pointer is not None:
        pointer = session.results.pointer
        rows.append(
            FrameRow(
                "pointermarker",
                "pointertip",
                "pointer",
                Pose.from_translation(pointer.value.tip_pointermarker),
                stale_reason("pointer", session),
                _made_utc(session, pointer),
                pointer.value.tip_sigma_mm,
            )
        )
    return tuple(rows)


def _registered(session: Session, derived: Derived[ToolRegistration]) -> list[FrameRow]:
    tool, reason = derived.value, stale_reason("tool", session)
    made_utc, covariance = _made_utc(session, derived), tool.covariance
    rows = [
        _tracker(session, tool, reason, made_utc),
        FrameRow(
            "toolmarker",
            "tip",
            "tool",
            tool.T_toolmarker_tip,
            reason,
            made_utc,
            tool.tip_sigma_mm,
            _sigma_deg(covariance[6:9, 6:9]),
        ),
    ]
    if tool.base is not None:
        T_base_basemarker = tool.base.T_base_basemarker
        place = T_base_basemarker.translation[None]
        sigma_mm = float(point_sigmas_mm(tool.T_base_tracker, covariance[:6, :6], place)[0])
        sigma_deg = _sigma_deg(covariance[:3, :3])
        rows.append(
            FrameRow(
                "base",
                "basemarker",
                "tool",
                T_base_basemarker,
                reason,
                made_utc,
                sigma_mm,
                sigma_deg,
            )
        )
    return rows


def _tracker(
    session: Session, tool: ToolRegistration, reason: str | None, made_utc: str | None
) -> FrameRow:
    """Return the tracker in ``base``: as registered, or as the newest stroke found it again."""
    source, T_base_tracker = "tool", tool.T_base_tracker
    covariance = tool.covariance[:6, :6]
    stroke = None if reason is not None else _newest_stroke(session)
    if stroke is not None:
        found = _found(session, stroke)
        if isinstance(found, str):
            reason = found
        elif found.state == "carried":
            source, T_base_tracker = "tool, base marker", found.T_base_tracker
            covariance = found.covariance
            made_utc = captured_utc(session, stroke.ordinal)
    reason = reason or placed_reason(session) or _moved_since(session, stroke)
    return FrameRow(
        "base",
        "tracker",
        source,
        T_base_tracker,
        reason,
        made_utc,
        _skull_sigma_mm(session, tool, T_base_tracker, covariance),
        _sigma_deg(covariance[:3, :3]),
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


def _found(session: Session, stroke: PointerCapture) -> TrackerReference | str:
    try:
        return reference_of(session, stroke)
    except RonaError as error:
        return str(error)


def _moved_since(session: Session, stroke: PointerCapture | None) -> str | None:
    """Return that the tracker was moved since it was seen last, None if it was not."""
    seen = session.captures.tool if stroke is None else stroke
    if seen is None or seen.tracker_place == session.setup.devices.tracker.place:
        return None
    return "the tracker was moved: the next stroke finds it again by the base marker"


def _made_utc(session: Session, derived: Derived[Any]) -> str | None:
    """Return when a result was computed, by the log."""
    return next(
        (
            entry.time_utc
            for entry in reversed(session.log)
            if entry.message == derived.message and entry.arguments == derived.arguments
        ),
        None,
    )


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
