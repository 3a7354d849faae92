"""Inputs of motion planning: the path, the robot and what stands around it."""

from dataclasses import dataclass

from rona_core.app.declarations.declarations import Arguments
from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.staleness import capture_input, result_input
from rona_core.app.messages.message import message_from
from rona_core.app.steps.path.inputs import SMOOTHING
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.setup.capture_parts import BASE, MODEL, OBSTACLES, SCAN_SPEED
from rona_core.devices.settings import RobotSettings
from rona_core.robot.base_placement.reachability import BasePlacement
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.captures import MotionCapture
from rona_core.session.document import Session, SmoothPath

ROLL: Input[RobotPlan] = result_input("roll")
PLACEMENT: Input[BasePlacement] = result_input("placement")


def last_roll_search(session: Session) -> StartRollSearch:
    """Return the last roll search, whether its plan is stale or not; the default before one."""
    searched = session.results.roll
    if searched is None:
        return StartRollSearch()
    return roll_search(searched.arguments)


def roll_search(arguments: Arguments) -> StartRollSearch:
    """Return the search in the arguments of a plan, without a roll chosen after it."""
    asked = {name: value for name, value in arguments.items() if name not in ("chosen", "branch")}
    return message_from(StartRollSearch.__name__, asked)


def _own_rolls(session: Session) -> StartRollSearch | None:
    rolls = last_roll_search(session)
    return None if rolls == StartRollSearch() else rolls


# None of the rolls that are searched by default: older results have no such input
OWN_ROLLS = Input(
    _own_rolls,
    "search the roll (step 7)",
    optional=True,
    title="the setting of the roll search (step 7)",
)


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """What every plan rests on."""

    robot: str  # its model
    scan_speed_mm_per_s: float
    obstacles: Obstacles


DRIVEN: Quantity[Driven] = Quantity(
    Driven, {"robot": MODEL, "scan speed": SCAN_SPEED, "obstacles": OBSTACLES}
)


@inputs()
class RollInputs:
    """What the motion of the scan is planned with."""

    smooth: SmoothPath = given(SMOOTHING, "smoothing")
    driven: Driven = given(DRIVEN)


@inputs()
class PlacementInputs:
    """What places of the robot's base are searched with."""

    smooth: SmoothPath = given(SMOOTHING, "smoothing")
    robot: RobotSettings = given(BASE, "base")
    rolls: StartRollSearch | None = given(OWN_ROLLS, "roll search")
    driven: Driven = given(DRIVEN)


MOTION: Input[MotionCapture] = capture_input("robot_motion")


@inputs()
class MotionInputs:
    """What a motion from elsewhere is held against."""

    motion: MotionCapture = given(MOTION, "motion")
    smooth: SmoothPath = given(SMOOTHING, "smoothing")
    driven: Driven = given(DRIVEN)
