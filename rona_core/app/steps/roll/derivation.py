"""Motion planning over the roll angle: search, choice, timing and certificate."""

from rona_core.app.dependencies.inputs import require_result
from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.devices.protocols import Cancel, Progress
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.planning.plan_scan import PlanSettings, choose_roll, plan_scan
from rona_core.robot.trajectory.scan_timing import ScanSettings
from rona_core.session.document import Session


def derive_roll(
    session: Session, message: StartRollSearch, *, progress: Progress, cancel: Cancel
) -> RobotPlan:
    """Judge every roll, and plan, time and verify the scan with the chosen one."""
    smooth = require_result(session.results.smoothing, "smooth the path").value
    return plan_scan(
        smooth.path,
        robot_model(session.setup.devices.robot.model),
        plan_settings(session, message),
        progress=progress,
        cancel=cancel,
    )


def plan_settings(session: Session, message: StartRollSearch) -> PlanSettings:
    """Return how to search and drive, from what was asked for and the robot's settings."""
    return PlanSettings(
        n_rolls=message.n_rolls,
        roll_from_deg=message.roll_from_deg,
        roll_to_deg=message.roll_to_deg,
        choice=message.choice,
        mode=message.mode,
        scan=ScanSettings(scan_speed_mm_per_s=session.setup.devices.robot.scan_speed_mm_per_s),
        obstacles=session_obstacles(session),
    )


def derive_chosen_roll(
    session: Session, plan: RobotPlan, index: int, branch: int | None = None
) -> RobotPlan:
    """Plan, time and verify the scan with another roll of a search, by default on its best branch.

    Raises:
        NotReachableError: the path cannot be followed with this roll; it says why.
    """
    model = robot_model(session.setup.devices.robot.model)
    settings = plan_settings(session, StartRollSearch())
    return choose_roll(plan, index, model, settings, branch=branch)
