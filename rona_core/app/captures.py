"""Record what the devices deliver. Stop ends a capture early; what came so far is kept."""

from collections.abc import Callable

import numpy as np

from rona_core.app.dependencies.staleness import capture_setup_digest, session_obstacles
from rona_core.app.messages.registry import (
    StartPathCapture,
    StartPointerCapture,
    StartRobotMove,
    StartSurfaceCapture,
    StartToolCapture,
)
from rona_core.app.steps.scan.certified_moves import FreeMoves, require_certified
from rona_core.app.toolbox import Toolbox
from rona_core.devices.protocols import Motion, never
from rona_core.devices.samples import JointSample, JointTrack, ToolTrack, TrackerFrame
from rona_core.errors import CancelledError, DeviceError, InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.calibration_motion import ToolMotionSettings, plan_tool_motion
from rona_core.session.document import PointerCapture, Session, ToolCapture

SAME_PLACE_RAD = 1e-6
ARRIVAL_S = 0.12  # after a motion, until the last joint angles have arrived
LIVE_PERIOD_S = 0.02  # how often a positioning move looks at Cancel
STOPPED = (
    "the robot was stopped on its way to the start: nothing was recorded, and what was recorded "
    "earlier is kept"
)


def begin(session: Session, tools: Toolbox) -> int:
    """Configure the devices from the session; return the ordinal of the capture that starts."""
    ordinal = len(session.archive) + 1
    tools.rig.begin(session.setup.devices, ordinal)
    return ordinal


def drive_to(q_rad: Floats, session: Session, tools: Toolbox) -> None:
    """Move the robot to joint angles (6,) on verified motions, around what stands in the way.

    Raises:
        NotReachableError: there is no such motion, or the verifier refuses it; it says why.
        CancelledError: somebody pressed Cancel or Stop on the way.
    """
    if tools.cancel():  # while what the robot is to do was planned
        raise CancelledError(STOPPED)
    model = robot_model(session.setup.devices.robot.model)
    begin(session, tools)
    start = tools.rig.robot.state().q_rad
    if np.abs(start - q_rad).max() < SAME_PLACE_RAD:
        return
    moves = FreeMoves(model, session_obstacles(session))
    for planned in moves.plan(start, q_rad):
        motion = tools.rig.robot.move(planned.times_s, planned.qs_rad)
        if not finish(motion, tools):
            raise CancelledError(STOPPED)


def capture_tool(activity: StartToolCapture, session: Session, tools: Toolbox) -> ToolCapture:
    """Record the tool marker and the joints while the robot pivots and translates the tool."""
    model = robot_model(session.setup.devices.robot.model)
    around = session_obstacles(session).without_touch()
    plan = plan_tool_motion(
        model,
        ToolMotionSettings(
            cone_deg=activity.cone_deg,
            n_pivot=activity.n_pivot,
            n_translate=activity.n_translate,
        ),
        obstacles=around,
    )
    require_certified("the tool motion", plan.certificate, plan, around)
    drive_to(plan.qs_rad[0], session, tools)
    ordinal = begin(session, tools)
    motion = tools.rig.robot.move(plan.times_s, plan.qs_rad)
    joints: list[JointSample] = []

    def with_joints(frame: TrackerFrame) -> bool:
        joints.append(tools.rig.robot.state())
        tools.live.put(joints=joints[-1])
        tools.progress(motion.progress())
        return motion.done()

    frames, partial = _record(tools, with_joints)
    return ToolCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest("tool", session),
        marker=ToolTrack.from_frames("toolmarker", frames),
        joints=JointTrack.from_samples(joints),
        dwell_start_s=readonly(np.array(plan.dwell_start_s)),
        dwell_end_s=readonly(np.array(plan.dwell_end_s)),
        phases=readonly(np.array(plan.phases, dtype=np.int64)),
        partial=partial or motion.progress() < 1.0,
        base=ToolTrack.from_frames("basemarker", frames),
        tracker_place=session.setup.devices.tracker.place,
    )


def capture_pivot(
    activity: StartPointerCapture, session: Session, tools: Toolbox
) -> PointerCapture:
    """Record the pointer marker while the pointer pivots about its tip."""
    operator = tools.rig.operator
    if not activity.by_hand:
        return capture_hand(
            "pointer",
            session,
            tools,
            lambda: operator.pivot(cone_deg=activity.cone_deg, duration_s=activity.duration_s),
        )
    try:
        return capture_hand(
            "pointer",
            session,
            tools,
            lambda: operator.pivot_by_hand(duration_s=activity.duration_s),
            lambda: not operator.in_hand(),
        )
    finally:
        operator.finish()


def capture_surface(
    activity: StartSurfaceCapture, session: Session, tools: Toolbox
) -> PointerCapture:
    """Record the pointer marker while the pointer slides over the skull."""
    return _capture_stroke(
        "surface",
        session,
        tools,
        activity,
        lambda: tools.rig.operator.sweep(duration_s=activity.duration_s),
    )


def capture_path(activity: StartPathCapture, session: Session, tools: Toolbox) -> PointerCapture:
    """Record the pointer marker while the pointer demonstrates the scan path."""
    return _capture_stroke(
        "path",
        session,
        tools,
        activity,
        lambda: tools.rig.operator.draw(
            spacing_mm=activity.spacing_mm, duration_s=activity.duration_s
        ),
    )


def move_robot(activity: StartRobotMove, session: Session, tools: Toolbox) -> None:
    """Move the robot to joint angles in degrees, certified first."""
    q_rad = np.deg2rad(np.array(activity.joints_deg))
    _check_joints(q_rad, robot_model(session.setup.devices.robot.model))
    drive_to(q_rad, session, tools)


def draw_probe_back(session: Session, tools: Toolbox) -> None:
    """Draw the probe back along its axis from where it stands, certified first.

    Raises:
        StepBlockedError: it stands clear of everything.
        NotReachableError: the joints or something in the way do not allow it; it says why.
        CancelledError: somebody pressed Cancel or Stop on the way.
    """
    model = robot_model(session.setup.devices.robot.model)
    begin(session, tools)
    clock = tools.rig.clock
    clock.wait_until(clock.now() + ARRIVAL_S)  # until it is known where it came to rest
    moves = FreeMoves(model, session_obstacles(session))
    line = moves.back(tools.rig.robot.state().q_rad)
    if not finish(tools.rig.robot.move(line.times_s, line.qs_rad), tools):
        raise CancelledError("the robot was stopped while it drew the probe back: retract again")


def _check_joints(q_rad: Floats, model: RobotModel) -> None:
    outside = (q_rad < model.lower_rad) | (q_rad > model.upper_rad)
    if outside.any():
        j = int(np.argmax(outside))
        low, high = np.rad2deg((model.lower_rad[j], model.upper_rad[j]))
        raise InvalidInputError(
            f"joint {j + 1} must be {low:.1f} to {high:.1f} deg, not {np.rad2deg(q_rad[j]):.6g}"
        )


def _capture_stroke(
    kind: str,
    session: Session,
    tools: Toolbox,
    activity: StartSurfaceCapture | StartPathCapture,
    without_picks: Callable[[], float],
) -> PointerCapture:
    """Let the pointer follow the picked places; without any, do what the operator does alone."""
    picks = np.array(activity.picks_base_mm)

    def along_picks() -> float:
        return tools.rig.operator.stroke(picks, duration_s=activity.duration_s)

    return capture_hand(kind, session, tools, along_picks if len(picks) else without_picks)


def capture_hand(
    kind: str,
    session: Session,
    tools: Toolbox,
    prepare: Callable[[], float],
    finished: Callable[[], bool] = never,
    *,
    tool: str | None = None,
) -> PointerCapture:
    """Record the marker of a tool in the hand, the pointer if none is named, while it moves."""
    pointer = session.setup.devices.pointer if tool is None else tool
    ordinal = begin(session, tools)
    duration_s = prepare()

    def until(frame: TrackerFrame) -> bool:
        tools.progress(min(1.0, frame.time_s / duration_s))
        return frame.time_s >= duration_s or finished()

    frames, partial = _record(tools, until)
    return PointerCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest(kind, session),
        pointer=pointer,
        marker=ToolTrack.from_frames(pointer, frames),
        partial=partial,
        base=ToolTrack.from_frames("basemarker", frames),
        tracker_place=session.setup.devices.tracker.place,
    )


def _record(
    tools: Toolbox, ended: Callable[[TrackerFrame], bool]
) -> tuple[list[TrackerFrame], bool]:
    """Collect tracker frames until ``ended`` or Cancel; return them and whether it was cut short.

    Raises:
        DeviceError: the tracker stopped delivering frames.
    """
    frames: list[TrackerFrame] = []
    for frame in tools.rig.tracker.frames():
        frames.append(frame)
        tools.live.put(frame=frame)
        if ended(frame):
            return frames, False
        if tools.cancel():
            tools.rig.robot.stop()
            return frames, True
    raise DeviceError("the tracker stopped delivering frames: is it connected and started?")


def finish(motion: Motion, tools: Toolbox) -> bool:
    """Let a motion end; return False if it was stopped instead."""
    clock = tools.rig.clock
    while not motion.done():
        if tools.cancel():
            tools.rig.robot.stop()
            return False
        clock.wait_until(clock.now() + LIVE_PERIOD_S)
        tools.live.put(joints=tools.rig.robot.state())
    clock.wait_until(clock.now() + ARRIVAL_S)
    tools.live.put(joints=tools.rig.robot.state())
    return True
