"""Certified motions of the robot from where it stands to where a step begins."""

import numpy as np

from rona_core.app.declarations.activity_context import ActivityContext
from rona_core.app.declarations.declarations import Message
from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.runtime.recording import begin, finish
from rona_core.app.steps.tool.certified_moves import FreeMoves
from rona_core.app.steps.tool.messages import StartRobotMove
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.session.document import Session

SAME_PLACE_RAD = 1e-6


STOPPED = (
    "the robot was stopped on its way to the start: nothing was recorded, and what was recorded "
    "earlier is kept"
)


def drive_to(q_rad: Floats, session: Session, tools: ActivityContext) -> None:
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


def move_robot(activity: StartRobotMove, session: Session, tools: ActivityContext) -> None:
    """Move the robot to joint angles in degrees, certified first."""
    q_rad = np.deg2rad(np.array(activity.joints_deg))
    _check_joints(q_rad, robot_model(session.setup.devices.robot.model))
    drive_to(q_rad, session, tools)


def _check_joints(q_rad: Floats, model: RobotModel) -> None:
    outside = (q_rad < model.lower_rad) | (q_rad > model.upper_rad)
    if outside.any():
        j = int(np.argmax(outside))
        low, high = np.rad2deg((model.lower_rad[j], model.upper_rad[j]))
        raise InvalidInputError(
            f"joint {j + 1} must be {low:.1f} to {high:.1f} deg, not {np.rad2deg(q_rad[j]):.6g}"
        )


def drive_robot(
    activity: StartRobotMove, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `StartRobotMove`; the session stays as it is."""
    move_robot(activity, session, context)
    return ()
