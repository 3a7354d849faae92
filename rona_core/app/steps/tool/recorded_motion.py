"""The tool marker and the joints, recorded along a calibration motion of the robot."""

from collections.abc import Callable

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.staleness import capture_setup_digest
from rona_core.app.runtime.recording import begin, record_frames
from rona_core.app.steps.tool.robot_motion import drive_to, require_certified
from rona_core.devices.protocols import Motion, Robot
from rona_core.devices.samples import JointSample, JointTrack, ToolTrack, TrackerFrame
from rona_core.geometry.arrays import readonly
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.calibration_motion import ToolMotion
from rona_core.session.captures import ToolCapture
from rona_core.session.document import Session

Start = Callable[[Robot, ToolMotion], Motion]


def freely(robot: Robot, plan: ToolMotion) -> Motion:
    """Start a calibration motion that nothing touches."""
    return robot.move(plan.times_s, plan.qs_rad)


def record_tool_motion(
    kind: str,
    plan: ToolMotion,
    model: RobotModel,
    around: Obstacles,
    session: Session,
    context: ActivityContext,
    start: Start = freely,
) -> ToolCapture:
    """Record the tool marker and the joints along a motion that was certified.

    Args:
        kind: Name of the capture.
        plan: The motion.
        model: The robot with the tool that it holds.
        around: What it was certified among.
        session: With the set-up.
        context: With the devices.
        start: How the robot carries it out.

    Raises:
        NotReachableError: the motion is not certified, or there is no way to where it begins.
        CancelledError: Cancel or Stop was pressed on the way there.
    """
    require_certified("the tool motion", plan.certificate, plan, model, around)
    drive_to(plan.qs_rad[0], session, context, model)
    ordinal = begin(session, context)
    motion = start(context.rig.robot, plan)
    joints: list[JointSample] = []

    def with_joints(frame: TrackerFrame) -> bool:
        joints.append(context.rig.robot.state())
        context.live.put(joints=joints[-1])
        context.progress(motion.progress())
        return motion.done()

    frames: list[TrackerFrame] = []
    partial = record_frames(context, with_joints, frames)
    return ToolCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest(kind, session),
        marker=ToolTrack.from_frames("toolmarker", frames),
        joints=JointTrack.from_samples(joints),
        dwell_start_s=readonly(np.array(plan.dwell_start_s)),
        dwell_end_s=readonly(np.array(plan.dwell_end_s)),
        phases=readonly(np.array(plan.phases, dtype=np.int64)),
        partial=partial or motion.progress() < 1.0,
        base=ToolTrack.from_frames("basemarker", frames),
        tracker_place=session.setup.devices.tracker.place,
    )
