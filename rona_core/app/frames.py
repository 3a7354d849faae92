"""The frame graph of a session: its transforms, where they come from, and if they are stale."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.inputs import stale_reason
from rona_core.devices.live import LiveState
from rona_core.geometry.pose import Pose
from rona_core.robot.model import robot_model
from rona_core.session.document import Session


@dataclass(frozen=True, slots=True, eq=False)
class FrameRow:
    """One edge of the graph: the pose of frame ``child`` in frame ``parent``, in mm."""

    parent: str
    child: str
    source: str  # step that made it, or "robot" (nominal), or "live"
    pose: Pose
    stale_reason: str | None = None  # None while it is up to date

    @property
    def name(self) -> str:
        """Name of the transform, ``T_parent_child``."""
        return f"T_{self.parent}_{self.child}"


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
        tool, reason = session.results.tool.value, stale_reason("tool", session)
        rows.append(FrameRow("base", "tracker", "tool", tool.T_base_tracker, reason))
        rows.append(FrameRow("toolmarker", "tip", "tool", tool.T_toolmarker_tip, reason))
    if session.results.pointer is not None:
        tip = Pose.from_translation(session.results.pointer.value.tip_pointermarker)
        reason = stale_reason("pointer", session)
        rows.append(FrameRow("pointermarker", "pointertip", "pointer", tip, reason))
    return tuple(rows)


def _reported(session: Session, live: LiveState) -> tuple[FrameRow, ...]:
    rows: list[FrameRow] = []
    if live.joints is not None:
        model = robot_model(session.setup.devices.robot.model)
        T_base_flange = model.forward(np.asarray(live.joints.q_rad)[None])[0]
        rows.append(FrameRow("base", "flange", "live", T_base_flange))
    pointer = session.setup.devices.pointer
    for sample in live.frame.tools if live.frame is not None else ():
        if sample.T_tracker_marker is not None and sample.tool in ("toolmarker", pointer):
            child = "pointermarker" if sample.tool == pointer else sample.tool
            rows.append(FrameRow("tracker", child, "live", sample.T_tracker_marker))
    return tuple(rows)
