"""Certified motions of the robot, and what is recorded along that of the calibration."""

from collections.abc import Callable

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext, Message
from rona_core.app.dependencies.staleness import capture_setup_digest, session_obstacles
from rona_core.app.runtime.handling import begin, finish, record_frames
from rona_core.app.steps.tool.messages import StartRobotMove
from rona_core.devices.protocols import Motion, Robot
from rona_core.devices.samples import JointSample, JointTrack, ToolTrack, TrackerFrame
from rona_core.errors import CancelledError, InvalidInputError, NotReachableError, StepBlockedError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.robot.collision.collision_world import CollisionWorld, require_clear
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.calibration_motion import ToolMotion
from rona_core.robot.trajectory.joint_moves import plan_joint_move
from rona_core.robot.trajectory.scan_timing import retract_after_stop
from rona_core.robot.trajectory.trajectory import TimedMotion, Trajectory
from rona_core.robot.verification.certificate import Certificate
from rona_core.robot.verification.verifier import verify_motion
from rona_core.session.captures import ToolCapture
from rona_core.session.document import Session
from rona_core.session.memo import Memo

SAME_PLACE_RAD = 1e-6
STOPPED = (
    "the robot was stopped on its way to the start: nothing was recorded, and what was recorded "
    "earlier is kept"
)

_PLANNED: Memo[tuple[Trajectory, ...]] = Memo(16)  # each scan weighs the tool in the same poses


class FreeMoves:
    """Plans moves on which nothing is touched: the probe may touch the head in a scan alone."""

    def __init__(self, model: RobotModel, around: Obstacles) -> None:
        """Look at a robot with its tool among what stands around it."""
        self._model, self._around = model, around
        self._free = around.without_touch()
        self._world = CollisionWorld(model, self._free)

    def plan(self, start_rad: Floats, goal_rad: Floats) -> tuple[Trajectory, ...]:
        """Return the certified motions, one after the other, from (6,) to (6,) joint angles.

        Where the probe still stands on the bone, as after a stop, it is drawn back first.

        Raises:
            NotReachableError: the goal touches something, there is no way around what does, or
                the verifier refuses a motion; it says why.
        """
        ends = start_rad.tobytes(), goal_rad.tobytes()
        among = self._model, self._around
        return _PLANNED.get(among, lambda: self._plan(start_rad, goal_rad), ends)

    def _plan(self, start_rad: Floats, goal_rad: Floats) -> tuple[Trajectory, ...]:
        model, motions = self._model, list[Trajectory]()
        require_clear(model, self._free, goal_rad)
        if not self.stands_clear(start_rad):
            motions.append(self._away(start_rad))
            start_rad = motions[-1].qs_rad[-1]
        planned = plan_joint_move(start_rad, goal_rad, model, clear=self._world.clear)
        certificate = verify_motion(model, planned, obstacles=self._free)
        require_certified("the move", certificate, planned, model, self._free)
        return (*motions, planned)

    def back(self, start_rad: Floats) -> Trajectory:
        """Return the certified motion that draws the probe back along its axis from the bone.

        Raises:
            StepBlockedError: it stands clear of everything.
            NotReachableError: there is no such motion, or the verifier refuses it.
        """
        if self.stands_clear(start_rad):
            raise StepBlockedError("the probe stands clear of everything, move the robot")
        return self._away(start_rad)

    def stands_clear(self, q_rad: Floats) -> bool:
        """Return whether nothing is touched, or nearly so, at joint angles (6,)."""
        return bool(self._world.clear(q_rad[None])[0])

    def _away(self, start_rad: Floats) -> Trajectory:
        model, around = self._model, self._around
        try:
            require_clear(model, around, start_rad, "stands")
        except NotReachableError as error:
            raise NotReachableError(
                f"{error}: undo what was changed since it went there, and move it away first"
            ) from error
        line = retract_after_stop(model, start_rad, CollisionWorld(model, around).clear)
        certificate = verify_motion(model, line, obstacles=around)
        require_certified("drawing the probe back", certificate, line, model, around)
        return line


def require_certified(
    what: str,
    certificate: Certificate,
    motion: TimedMotion,
    model: RobotModel,
    around: Obstacles,
) -> None:
    """Raise NotReachableError unless this robot may drive this motion among what stands around."""
    refusal = certificate.refusal(motion, model, around)
    if refusal is not None:
        raise NotReachableError(f"{what} is refused: {refusal}")


def drive_to(
    q_rad: Floats, session: Session, context: ActivityContext, model: RobotModel | None = None
) -> None:
    """Move the robot to joint angles (6,) on verified motions, around what stands in the way.

    ``model`` has the tool that is in its hand; without, that is the probe.

    Raises:
        NotReachableError: there is no such motion, or the verifier refuses it; it says why.
        CancelledError: Cancel or Stop was pressed on the way.
    """
    if context.cancel():  # while what the robot is to do was planned
        raise CancelledError(STOPPED)
    model = model or robot_model(session.setup.devices.robot.model)
    begin(session, context)
    start = context.rig.robot.state().q_rad
    if same_place(start, q_rad):
        return
    moves = FreeMoves(model, session_obstacles(session))
    for planned in moves.plan(start, q_rad):
        motion = context.rig.robot.move(planned.times_s, planned.qs_rad)
        if not finish(motion, context):
            raise CancelledError(STOPPED)


def same_place(q_rad: Floats, other_rad: Floats) -> bool:
    """Return whether joint angles (6,) are those of a robot that rests there."""
    return bool(np.abs(q_rad - other_rad).max() < SAME_PLACE_RAD)


def move_robot(
    activity: StartRobotMove, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `StartRobotMove`, certified first; the session stays as it is."""
    q_rad = np.deg2rad(np.array(activity.joints_deg))
    drive_to(q_rad, session, context)
    return ()


def require_joint_limits(activity: StartRobotMove, session: Session) -> None:
    """Raise InvalidInputError unless the chosen robot's joints can be at the angles of a move."""
    model = robot_model(session.setup.devices.robot.model)
    q_rad = np.deg2rad(np.array(activity.joints_deg))
    outside = (q_rad < model.lower_rad) | (q_rad > model.upper_rad)
    if outside.any():
        j = int(np.argmax(outside))
        low, high = np.rad2deg((model.lower_rad[j], model.upper_rad[j]))
        raise InvalidInputError(
            f"joint {j + 1} must be {low:.1f} to {high:.1f} deg, not {np.rad2deg(q_rad[j]):.6g}"
        )


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
