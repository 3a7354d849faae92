"""Roll: motion planning over the free angle about the probe, and placement of the base."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import Arguments
from rona_core.app.dependencies.inputs import require_result, result_input
from rona_core.app.dependencies.requirements import require_inputs
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.messages.message import values_of
from rona_core.app.runtime.handling import compute_one
from rona_core.app.steps.roll import messages
from rona_core.app.steps.roll.base_placement import (
    OWN_ROLLS,
    derive_placement,
    find_placement,
    recompute_placement,
    require_move,
    roll_search,
)
from rona_core.app.steps.roll.derivation import derive_chosen_roll, derive_roll
from rona_core.app.steps.roll.plan_reasons import plan_reason, roll_summary
from rona_core.app.steps.setup.inputs import BASE, DRIVEN
from rona_core.app.steps.setup.messages import SetRobot
from rona_core.app.steps.setup.step import set_robot
from rona_core.app.steps.tool.messages import StartRobotMove
from rona_core.app.steps.tool.robot_motion import move_robot, require_joint_limits
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import StaleResultError
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.document import Derived, Session

SMOOTHING, ROLL, PLACEMENT = (result_input(name) for name in ("smoothing", "roll", "placement"))


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
    searched: Derived[RobotPlan] = require_result(session.results.roll, "plan the motion (step 7)")
    plan = derive_chosen_roll(session, searched.value, message.index, message.branch)
    arguments = {**searched.arguments, "chosen": message.index, "branch": message.branch}
    made = Derived(plan, searched.message, arguments, searched.inputs)
    return session.with_result("roll", made)


def recompute_roll(
    session: Session, arguments: Arguments, progress: Progress, cancel: Cancel
) -> RobotPlan:
    """Search again, and take again the roll that somebody chose after the search."""
    chosen, branch = arguments.get("chosen"), arguments.get("branch")
    plan = derive_roll(session, roll_search(arguments), progress=progress, cancel=cancel)
    if not isinstance(chosen, int):
        return plan
    return derive_chosen_roll(session, plan, chosen, branch if isinstance(branch, int) else None)


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
            messages.StartRollSearch, compute_one, "Searching the roll", needs=(SMOOTHING,)
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
        declare.Result(
            "roll",
            messages.StartRollSearch,
            derive_roll,
            {"smoothing": SMOOTHING, **DRIVEN},
            "plan the motion (step 7)",
            recompute=recompute_roll,
        ),
        declare.Result(
            "placement",
            messages.StartBasePlacement,
            derive_placement,
            {"smoothing": SMOOTHING, "base": BASE, "roll search": OWN_ROLLS, **DRIVEN},
            "look for a place of the base (step 7)",
            recompute=recompute_placement,
        ),
    ),
    line=declare.StepLine(
        "Roll",
        roll_summary,
        messages.StartRollSearch,
        leaves=lambda session: (ROLL,),
        unusable=plan_reason,
    ),
)
