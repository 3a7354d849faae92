"""Motion planning over the roll angle: search, choice, timing and certificate."""

from rona_core.app.declarations.declarations import Arguments
from rona_core.app.steps.roll.inputs import Driven, RollInputs, roll_search
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.devices.protocols import Cancel, Progress
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.planning.plan_motion import PlanSettings, choose_roll, plan_scan
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
