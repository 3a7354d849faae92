"""The frame graph of a session: its transforms, where they come from, and if they are stale."""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.references import placed_reason, reference_of
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.implant.burr.derivation import BurrRegistration
from rona_core.app.steps.implant.derivation import ImplantBed
from rona_core.calibration.hand_eye.reference_markers import head_reference, point_sigmas_mm
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.devices.live import LiveState
from rona_core.devices.samples import ToolTrack
from rona_core.devices.settings import SONO
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.session.captures import PointerCapture, is_imported
from rona_core.session.document import Derived, Session
from rona_core.ultrasound.acoustic_calibration.probe_mounting import ProbeMounting


@dataclass(frozen=True, slots=True, eq=False)
class FrameRow:
    """One edge of the graph: the pose of frame ``child`` in frame ``parent``, in mm."""

    parent: str
    child: str
    source: str  # step that made it, and by what; or "robot" (nominal), or "live"
    pose: Pose
    stale_reason: str | None = None  # None while it is up to date
    time_utc: str | None = None  # when it was measured or computed; None: nominal, or now
    sigma_mm: float | None = None  # predicted 3D error, of T_base_tracker at the skull; None:
    # nominal or live, or a place that was chosen and so has no error (map, bed)
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
    return (
        *_tool(session),
        *_calibrated(session),
        *_head(session),
        *_planned(session),
        *_hand(session),
        *_reported(session, live or LiveState()),
    )


def _tool(session: Session) -> tuple[FrameRow, ...]:
    """Return the tool as drawn, but for what the gauge plate and the seat of the burr measured."""
    model = robot_model(session.setup.devices.robot.model)
    rows = (
        FrameRow("flange", "tip", "robot", model.T_flange_tip),
        _probe(session, model),
        FrameRow("flange", "toolmarker", "robot", model.T_flange_toolmarker),
    )
    burr: Derived[BurrRegistration] | None = session.results.get("burr")
    if burr is None:
        return rows
    pose = Pose.from_translation(burr.value.offset_tip)
    row = _made(session, "burr", ("tip", "burr"), pose, "implant, seat of the burr")
    return (*rows, replace(row, sigma_mm=burr.value.tip_sigma_mm))


def _probe(session: Session, model: RobotModel) -> FrameRow:
    """Return the face of the probe: where its mounting was found, as drawn before or if bad."""
    held: Derived[ProbeMounting] | None = session.results.get("mounting")
    if held is None or judge_part("mounting", session).state == "bad":
        return FrameRow("flange", "probe", "robot", model.T_flange_probe)
    pose = model.T_flange_probe @ Pose.from_translation((0.0, 0.0, held.value.offset_mm))
    row = _made(session, "mounting", ("flange", "probe"), pose, "scan, gauge plate")
    return replace(row, sigma_mm=held.value.sigma_mm)


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


def _head(session: Session) -> tuple[FrameRow, ...]:
    """Return the marker on the head as it lay in step 4, and the file of a loaded skull."""
    strokes, rows = session.captures.surface, list[FrameRow]()
    if strokes and strokes[0].head is not None:
        with suppress(RonaError):  # seen too rarely, or the tracker was moved: no such frame
            rows.append(_head_marker(session, strokes[0], strokes[0].head))
    registered = session.results.registration
    if registered is not None:
        found = registered.value
        T_base_skull = found.T_b_a.inv()
        row = _made(session, "registration", ("base", "skull"), T_base_skull, "surface")
        at_patch_mm = float(found.target_errors_mm((T_base_skull @ found.center_b)[None])[0])
        turn_deg = _sigma_deg(found.covariance[:3, :3])
        rows.append(replace(row, sigma_mm=at_patch_mm, sigma_deg=turn_deg))
    return tuple(rows)


def _head_marker(session: Session, first: PointerCapture, head: ToolTrack) -> FrameRow:
    at = reference_of(session, first)
    pose = at.T_base_tracker @ head_reference(head).T_tracker_headmarker
    return FrameRow(
        "base",
        "headmarker",
        "surface, head marker",
        pose,
        stale_reason("capture surface", session) or stale_reason("tool", session),
        captured_utc(session, first.ordinal),
        float(at.sigma_mm(pose.translation[None])[0]),
        _sigma_deg(at.covariance[:3, :3]),
    )


def _planned(session: Session) -> tuple[FrameRow, ...]:
    """Return the planes of the robot's maps and of the implant's seat."""
    rows = list[FrameRow]()
    maps = session.results.maps
    bed: Derived[ImplantBed] | None = session.results.get("bed")
    if maps is not None:
        rows.append(_made(session, "maps", ("base", "map"), maps.value.outer.T_base_map))
    if bed is not None and bed.value.placed is not None:
        T_base_bed = bed.value.placed.T_base_bed
        rows.append(_made(session, "bed", ("base", "bed"), T_base_bed, "implant"))
    return tuple(rows)


def _hand(session: Session) -> tuple[FrameRow, ...]:
    """Return the probe in the hand, and the plane of its maps."""
    rows, found, maps = list[FrameRow](), session.results.sono, session.results.sono_maps
    if found is not None:
        edge, by = ("sonomarker", "handprobe"), "maps, calibration by hand"
        row = _made(session, "sono", edge, found.value.T_sonomarker_probe, by)
        sigma = found.value.face_sigma_mm, found.value.axis_sigma_deg
        rows.append(replace(row, sigma_mm=sigma[0], sigma_deg=sigma[1]))
    if maps is not None:
        edge, plane = (maps.value.frame, "handmap"), maps.value.maps.outer.T_base_map
        rows.append(_made(session, "sono_maps", edge, plane, "maps, scan by hand"))
    return tuple(rows)


def _made(
    session: Session, result: str, edge: tuple[str, str], pose: Pose, source: str = ""
) -> FrameRow:
    """Return an edge that a result made, without how sure it is; by default of its own step."""
    reason, made_utc = stale_reason(result, session), _made_utc(session, result)
    return FrameRow(*edge, source or result, pose, reason, made_utc)


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
    if made is None:
        return None
    for entry in reversed(session.log):
        stored = entry.arguments.get("values")  # results of an activity, by name
        outcome = isinstance(stored, dict) and result in stored
        if outcome or (entry.message, entry.arguments) == (made.message, made.arguments):
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
        child = {pointer: "pointermarker", SONO: "sonomarker"}.get(sample.tool, sample.tool)
        if sample.T_tracker_marker is not None and child.endswith("marker"):
            rows.append(FrameRow("tracker", child, "live", sample.T_tracker_marker))
    return tuple(rows)
