"""Roll: motion planning over the free angle about the probe, and placement of the base."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.dependencies.judge import require_inputs
from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.messages.message import values_of
from rona_core.app.runtime.handling import compute
from rona_core.app.steps.roll import messages
from rona_core.app.steps.roll.base_placement import (
    find_placement,
    judge_places,
    judge_plan,
    require_move,
)
from rona_core.app.steps.roll.derivation import (
    plan_chosen_roll,
    plan_motion,
    plan_motion_again,
)
from rona_core.app.steps.roll.inputs import DRIVEN, PLACEMENT, ROLL, SMOOTHING
from rona_core.app.steps.roll.place_search import find_places, find_places_again
from rona_core.app.steps.roll.plan_reasons import roll_summary
from rona_core.app.steps.setup.messages import SetRobot
from rona_core.app.steps.setup.step import set_robot
from rona_core.app.steps.tool.messages import StartRobotMove
from rona_core.app.steps.tool.robot_motion import move_robot, require_joint_limits
from rona_core.errors import StaleResultError, StepBlockedError
from rona_core.session.document import Derived, Session


def apply_base_placement(message: messages.ApplyBasePlacement, session: Session) -> Session:
    """Carry out `ApplyBasePlacement`."""
    require_inputs(type(message), session)
    reason = stale_reason("placement", session)
    if reason is not None:
        raise StaleResultError(f"{reason}: look for a place of the base again (step 7)")
    robot = require_move(session, message.place)
    return set_robot(SetRobot(**values_of(robot, SetRobot)), session)


def choose_roll(message: messages.ChooseRoll, session: Session) -> Session:
    """Carry out `ChooseRoll`."""
    require_inputs(type(message), session)
    searched = session.results.roll
    if searched is None:
        raise StepBlockedError("first plan the motion (step 7)")
    driven = required(DRIVEN, session)
    plan = plan_chosen_roll(driven, searched.value, message.index, message.branch)
    arguments = {**searched.arguments, "chosen": message.index, "branch": message.branch}
    made = Derived(plan, searched.message, arguments, searched.inputs)
    return session.with_result("roll", made)


STEP = declare.Step(
    "roll",
    commands=(
        declare.Command(messages.ChooseRoll, choose_roll, needs=(ROLL,)),
        declare.Command(
            messages.ApplyBasePlacement, apply_base_placement, needs=(PLACEMENT,), takes_stale=True
        ),
    ),
    activities=(
        declare.Activity(
            messages.StartRollSearch, compute, "Searching the roll", needs=(SMOOTHING,)
        ),
        declare.Activity(
            messages.StartBasePlacement,
            find_placement,
            "Looking for places of the base",
            needs=(SMOOTHING,),
        ),
        declare.Activity(
            StartRobotMove,
            move_robot,
            "Moving the robot",
            drives_robot=True,
            check=require_joint_limits,
        ),
    ),
    results=(
        declare.Result.of(
            "roll",
            messages.StartRollSearch,
            plan_motion,
            "plan the motion (step 7)",
            judged=judge_plan,
            recompute=plan_motion_again,
        ),
        declare.Result.of(
            "placement",
            messages.StartBasePlacement,
            find_places,
            "look for a place of the base (step 7)",
            recompute=find_places_again,
            judged=judge_places,
        ),
    ),
    line=declare.StepLine(
        "Roll",
        roll_summary,
        messages.StartRollSearch,
        leaves=lambda session: (ROLL,),
    ),
)
