"""Roll: motion over the free angle about the probe, placement of the base, files of both."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import (
    USABLE,
    ActivityContext,
    Export,
    Judgement,
    Remedy,
)
from rona_core.app.dependencies.judge import fresh, require_inputs
from rona_core.app.dependencies.staleness import required, session_obstacles, stale_reason
from rona_core.app.messages.message import StoreResult, serialize_arguments, values_of
from rona_core.app.runtime.handling import compute, compute_result
from rona_core.app.steps.roll import messages
from rona_core.app.steps.roll.certificate_view import plan_reason, roll_summary
from rona_core.app.steps.roll.derivation import (
    ROLLS,
    find_places,
    find_places_again,
    plan_chosen_roll,
    plan_motion,
    plan_motion_again,
    take_motion,
    take_motion_again,
)
from rona_core.app.steps.roll.inputs import DRIVEN, MOTION, OWN_ROLLS, PLACEMENT, ROLL, SMOOTHING
from rona_core.app.steps.roll.messages import ApplyBasePlacement, StartBasePlacement
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.setup.messages import SetRobot
from rona_core.app.steps.setup.step import set_robot
from rona_core.app.steps.tool.messages import StartRobotMove
from rona_core.app.steps.tool.robot_motion import move_robot, require_joint_limits
from rona_core.devices.settings import RobotSettings
from rona_core.errors import NotReachableError, StaleResultError, StepBlockedError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.robot.base_placement.reachability import BasePlace, BasePlacement, base_pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.motion_files.certified import CertifiedMotion
from rona_core.robot.motion_files.formats import URSCRIPT, WRITERS
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.verification.certificate import Certificate
from rona_core.session.captures import MotionCapture
from rona_core.session.document import Derived, Session

Motion = Callable[[Session], CertifiedMotion]


def motion_exports(name: str, says: str, motion: Motion) -> tuple[Export, ...]:
    """Return an export of a motion in each format."""

    def written(write: Callable[[CertifiedMotion], bytes], session: Session) -> bytes:
        return write(motion(session))

    return tuple(
        Export(f"{name}.{ending}", f"{says}: {words}", partial(written, write), "motion")
        for ending, (words, write) in WRITERS.items()
    )


def is_urscript(name: str) -> bool:
    """Return whether an export is for arms of Universal Robots alone."""
    return name.endswith(f".{URSCRIPT}")


def held(certificate: Certificate | None) -> Certificate:
    """Return a certificate.

    Raises:
        StepBlockedError: there is none.
    """
    if certificate is None:
        raise StepBlockedError("the motion was never verified: plan it again")
    return certificate


def scan_motion(session: Session) -> CertifiedMotion:
    """Return the planned motion of the scan, certified for the robot and surroundings of now.

    Its table has the way along the scan path beside each sample.

    Raises:
        StepBlockedError: there is no plan, or none that is certified; it says why.
        StaleResultError: the plan is out of date.
    """
    plan = required(ROLL, session)
    if (reason := stale_reason("roll", session)) is not None:
        raise StaleResultError(f"the plan of the scan is stale: {reason}")
    motion, certificate = plan.trajectory, held(plan.certificate)
    if motion is None or not plan.may_move:
        raise StepBlockedError(f"the robot cannot scan this path: {plan_reason(session)}")
    model = robot_model(session.setup.devices.robot.model)
    refusal = certificate.refusal(motion, model, session_obstacles(session))
    if refusal is not None:
        raise StepBlockedError(f"the robot cannot scan this path: {refusal}")
    columns = {"path_mm": motion.path_mm.tolist()}
    return CertifiedMotion(model, motion, certificate, "scan_path", columns)


EXPORTS = motion_exports("scan_motion", "certified scan", scan_motion)


__all__ = ["BasePlace", "BasePlacement", "PlacementView", "fresh_placement", "placement_view"]


Which = Literal["best", "smallest"]
STILL_MM, STILL_DEG = 0.5, 0.05  # a base that moves by less stays where it is


def find_placement(
    message: StartBasePlacement, session: Session, context: ActivityContext
) -> tuple[StoreResult, ...]:
    """Carry out `StartBasePlacement`; rolls of one's own are stored with the result."""
    (found,) = compute(message, session, context)
    rolls = OWN_ROLLS.read(session)
    if rolls is None:
        return (found,)
    return (replace(found, arguments={**found.arguments, ROLLS: serialize_arguments(rolls)}),)


def moves(place: BasePlace) -> bool:
    """Return whether a place is another one than where the base stands."""
    return place.moved_mm > STILL_MM or place.turned_deg > STILL_DEG


def advice(placement: BasePlacement) -> str:
    """Return in a sentence where to put the base, or that no place helps."""
    near, best = placement.smallest, placement.best
    if near is None or best is None:
        return f"Change the path: {'; '.join(placement.reasons[1:])}"
    if not moves(near):
        return "The base may stay: a motion from where it stands is certified"
    farther = "" if best is near else f". With the largest margin: {best.sentence}"
    return f"Move the robot base. The smallest move that was certified: {near.sentence}{farther}"


def judge_plan(plan: RobotPlan, session: Session) -> Judgement:
    """Return whether a planned motion can be driven, and which place of the base would help."""
    reason = plan_reason(session)
    if reason is None:
        return USABLE
    found = fresh_placement(session)
    if found is None:
        remedy = Remedy("look for a place of the base (step 7)", StartBasePlacement())
    elif found.smallest is not None and moves(found.smallest):
        remedy = Remedy("move the base (step 7)", ApplyBasePlacement())
    else:
        remedy = Remedy("choose another roll (step 7) or change the path (step 5)")
    return Judgement("bad", reason, remedy)


def judge_places(found: BasePlacement, session: Session) -> Judgement:
    """Return whether a search found a place of the base."""
    if found.smallest is not None:
        return USABLE
    return Judgement("bad", "; ".join(found.reasons), Remedy("change the path (step 5)"))


def require_move(session: Session, which: Which) -> RobotSettings:
    """Return the robot's settings with its base at the place that was found.

    Raises:
        NotReachableError: no place was found, or the base stands there already.
    """
    placement = required(PLACEMENT, session)
    place = placement.best if which == "best" else placement.smallest
    if place is None:
        raise NotReachableError(f"the base stays where it is: {placement.reasons[-1]}")
    if not moves(place):
        raise NotReachableError("the base stays where it is: the scan works from there")
    return place.moved(session.setup.devices.robot)


@dataclass(frozen=True, slots=True, eq=False)
class PlacementView:
    """Cells of the map, and the two places that were planned in full."""

    room: Pose  # pose in ``base`` of the base at its default place
    x_mm: Floats  # (nx,) middles of the cells, along x of the room
    y_mm: Floats  # (ny,)
    margins: Floats  # (nx, ny) 0 and more seems to work
    blocked: Bools  # (nx, ny)
    best: Pose | None  # pose of the base there; None where there is none, or no move
    smallest: Pose | None


def fresh_placement(session: Session) -> BasePlacement | None:
    """Return the places that were found, while they hold for the robot and path of now."""
    return fresh("placement", session)


def placement_view(session: Session) -> PlacementView | None:
    """Return what to draw; None while no search holds."""
    found = fresh_placement(session)
    if found is None:
        return None
    robot = session.setup.devices.robot
    room = base_pose(robot.base_shift_mm, robot.base_turn_deg).inv()

    def pose(place: BasePlace | None) -> Pose | None:
        if place is None or not moves(place):
            return None
        return room @ base_pose(place.shift_mm, place.turn_deg)

    return PlacementView(
        room=room,
        x_mm=found.x_mm,
        y_mm=found.y_mm,
        margins=found.margins.astype(float),
        blocked=found.blocked,
        best=pose(found.best),
        smallest=pose(found.smallest),
    )


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
    captures=(
        declare.Capture(
            "robot_motion",
            "import a motion (step 7)",
            (parts.robot, parts.robot_errors),
            types=(MotionCapture,),
            done="the motion was imported",
        ),
    ),
    commands=(
        declare.Command(messages.TakeMotion, compute_result, needs=(MOTION, SMOOTHING)),
        declare.Command(
            messages.ChooseRoll, choose_roll, needs=(ROLL,), done="the roll was chosen"
        ),
        declare.Command(
            messages.ApplyBasePlacement,
            apply_base_placement,
            needs=(PLACEMENT,),
            takes_stale=True,
            done="the base of the robot was moved",
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
        replace(
            declare.Result.of(
                "roll",
                messages.StartRollSearch,
                plan_motion,
                "plan the motion (step 7)",
                judged=judge_plan,
                done="the motion was planned",
            ),
            recompute=plan_motion_again,
        ),
        replace(
            declare.Result.of(
                "roll",
                messages.TakeMotion,
                take_motion,
                "plan the motion (step 7)",
                judged=judge_plan,
                done="the imported motion was verified",
            ),
            recompute=take_motion_again,
        ),
        replace(
            declare.Result.of(
                "placement",
                messages.StartBasePlacement,
                find_places,
                "look for a place of the base (step 7)",
                judged=judge_places,
                done="the places of the base were found",
            ),
            recompute=find_places_again,
        ),
    ),
    exports=EXPORTS,
    line=declare.StepLine(
        "Roll",
        roll_summary,
        messages.StartRollSearch,
        leaves=lambda session: (ROLL,),
    ),
)
