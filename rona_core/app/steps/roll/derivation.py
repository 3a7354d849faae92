"""Motion planning over the roll angle, and the search of places of the robot's base."""

from dataclasses import replace

from rona_core.app.declarations.declarations import Arguments
from rona_core.app.messages.message import message_from
from rona_core.app.steps.roll.inputs import (
    Driven,
    MotionInputs,
    PlacementInputs,
    RollInputs,
    roll_search,
)
from rona_core.app.steps.roll.messages import StartBasePlacement, StartRollSearch, TakeMotion
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import InvalidInputError
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.robot.base_placement.placement import place_base
from rona_core.robot.base_placement.reachability import ALL_AROUND_DEG, BasePlacement
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.given_motion import plan_of_motion
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.planning.plan_motion import PlanSettings, choose_roll, plan_scan
from rona_core.robot.redundancy.constant_roll import working_set_deg
from rona_core.robot.trajectory.scan_timing import ScanSettings


def plan_motion(
    known: RollInputs, message: StartRollSearch, *, progress: Progress, cancel: Cancel
) -> RobotPlan:
    """Judge every roll, and plan, time and verify the scan with the chosen one."""
    return plan_scan(
        known.smooth.path,
        robot_model(known.driven.robot),
        plan_settings(known.driven, message),
        progress=progress,
        cancel=cancel,
    )


def plan_settings(driven: Driven, message: StartRollSearch) -> PlanSettings:
    """Return how to search and drive."""
    return PlanSettings(
        n_rolls=message.n_rolls,
        roll_from_deg=message.roll_from_deg,
        roll_to_deg=message.roll_to_deg,
        choice=message.choice,
        mode=message.mode,
        scan=ScanSettings(scan_speed_mm_per_s=driven.scan_speed_mm_per_s),
        obstacles=driven.obstacles,
    )


def plan_chosen_roll(
    driven: Driven, plan: RobotPlan, index: int, branch: int | None = None
) -> RobotPlan:
    """Plan, time and verify the scan with another roll of a search, by default on its best branch.

    Raises:
        NotReachableError: the path cannot be followed with this roll; it says why.
    """
    settings = plan_settings(driven, StartRollSearch())
    return choose_roll(plan, index, robot_model(driven.robot), settings, branch=branch)


def plan_motion_again(
    known: RollInputs, arguments: Arguments, progress: Progress, cancel: Cancel
) -> RobotPlan:
    """Search again, and take again the roll that was chosen after the search."""
    chosen, branch = arguments.get("chosen"), arguments.get("branch")
    plan = plan_motion(known, roll_search(arguments), progress=progress, cancel=cancel)
    if not isinstance(chosen, int):
        return plan
    return plan_chosen_roll(known.driven, plan, chosen, branch if isinstance(branch, int) else None)


def take_motion(known: MotionInputs, message: TakeMotion) -> RobotPlan:
    """Hold a motion from elsewhere against the path.

    Raises:
        InvalidInputError: the probe does not come to an end of the path.
    """
    driven = known.driven
    return plan_of_motion(
        known.motion,
        known.smooth.path,
        robot_model(driven.robot),
        driven.scan_speed_mm_per_s,
        driven.obstacles,
    )


def take_motion_again(
    known: MotionInputs, arguments: Arguments, progress: Progress, cancel: Cancel
) -> RobotPlan:
    """Hold it against the path again, and take again the roll that was chosen after it."""
    chosen, branch = arguments.get("chosen"), arguments.get("branch")
    plan = take_motion(known, TakeMotion())
    if not isinstance(chosen, int):
        return plan
    return plan_chosen_roll(known.driven, plan, chosen, branch if isinstance(branch, int) else None)


ROLLS = "rolls"  # in the arguments of a result, beside the fields of its message


def _screened_deg(rolls: StartRollSearch) -> tuple[float, ...]:
    """Return rolls of the working set, evenly chosen, at most as many as are screened."""
    working = working_set_deg(rolls.n_rolls, rolls.roll_from_deg, rolls.roll_to_deg)
    return tuple(working[:: -(-len(working) // len(ALL_AROUND_DEG))].tolist())


def find_places_again(
    known: PlacementInputs, arguments: Arguments, progress: Progress, cancel: Cancel
) -> BasePlacement:
    """Search again with the rolls of then: the plan that had them may be stale."""
    asked = dict(arguments)
    rolls = asked.pop(ROLLS, {})
    if not isinstance(rolls, dict):
        raise InvalidInputError(f"the rolls of a placement must be an object, not {rolls!r}")
    message = message_from(StartBasePlacement.__name__, asked)
    then = replace(known, rolls=roll_search(rolls))
    return find_places(then, message, progress=progress, cancel=cancel)


def find_places(
    known: PlacementInputs, message: StartBasePlacement, *, progress: Progress, cancel: Cancel
) -> BasePlacement:
    """Search places of the base; what is suggested is planned and certified among everything.

    Rolls and mode are those of the last roll search: where it was for a constant roll, no place is
    suggested from which only a varying one works.
    """
    rolls = known.rolls or StartRollSearch()
    model = robot_model(known.driven.robot)
    settings = plan_settings(known.driven, rolls)
    around = settings.obstacles

    def planner(path: Path5D, old_in_new: Pose) -> RobotPlan:
        seen = obstacles_from(around, old_in_new)
        return plan_scan(path, model, replace(settings, obstacles=seen), cancel=cancel)

    return place_base(
        known.smooth.path,
        model,
        known.robot,
        search=replace(message.search(), rolls_deg=_screened_deg(rolls)),
        planner=planner,
        progress=progress,
        cancel=cancel,
    )


def obstacles_from(obstacles: Obstacles, old_in_new: Pose) -> Obstacles:
    """Return what stands around, seen from a new place of the base.

    Args:
        obstacles: In ``base`` as the base stands now.
        old_in_new: Pose of the base as it stands now, in the frame of the base at its new place.
    """
    things = tuple(replace(thing, pose=old_in_new @ thing.pose) for thing in obstacles.things)
    return replace(obstacles, things=things)
