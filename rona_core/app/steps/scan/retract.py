"""Retract: the probe is drawn straight back from the bone, as after a stop."""

from rona_core.app.declarations.activity_context import ActivityContext
from rona_core.app.declarations.declarations import Message
from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.runtime.recording import ARRIVAL_S, begin, finish
from rona_core.app.steps.scan.messages import StartRetract
from rona_core.app.steps.tool.certified_moves import FreeMoves
from rona_core.errors import CancelledError
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session


def draw_probe_back(session: Session, tools: ActivityContext) -> None:
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


def retract(
    activity: StartRetract, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `StartRetract`; the session stays as it is."""
    draw_probe_back(session, context)
    return ()
