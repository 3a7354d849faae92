"""The spindle turned about its tip in a seat, recorded by encoders and tracker."""

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.tool.robot_motion import record_tool_motion
from rona_core.devices.protocols import Motion, Robot
from rona_core.errors import NotReachableError
from rona_core.robot.kinematics.catalog import milling_robot
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.calibration_motion import (
    ToolMotion,
    ToolMotionSettings,
    plan_tool_motion,
)
from rona_core.session.captures import ToolCapture
from rona_core.session.document import Session

OUT_OF_SEAT_MM = 1.0  # a commanded tip that leaves it further would be drawn out of the seat


def capture_burr(
    activity: StartBurrCapture, session: Session, context: ActivityContext
) -> ToolCapture:
    """Record joints and marker while the robot turns the spindle about its tip in the seat.

    The seat stands where the tool pivots in step 2, clear of the head.

    Raises:
        NotReachableError: the arm does not reach all poses, or something is in the way.
        CancelledError: Cancel or Stop was pressed before it was in the seat.
    """
    model = milling_robot(session.setup.devices.robot.model)
    around = session_obstacles(session).without_touch()
    settings = ToolMotionSettings(
        cone_deg=activity.cone_deg, n_pivot=activity.n_pivot, n_translate=0
    )
    plan = plan_tool_motion(model, settings, obstacles=around)
    _require_seated(plan, model)
    return record_tool_motion("burr", plan, model, around, session, context, start=_in_seat)


def _in_seat(robot: Robot, plan: ToolMotion) -> Motion:
    """Start a motion whose tip is in the seat from the first rest to the last."""
    return robot.move_seated(plan.times_s, plan.qs_rad, _seated_s(plan))


def _seated_s(plan: ToolMotion) -> tuple[float, float]:
    return float(plan.dwell_start_s[0]), float(plan.dwell_end_s[-1])


def _require_seated(plan: ToolMotion, model: RobotModel) -> None:
    start_s, end_s = _seated_s(plan)
    qs_rad = plan.qs_rad[(plan.times_s >= start_s) & (plan.times_s <= end_s)]
    tips = (model.forward(qs_rad) @ model.T_flange_tip).translations
    away_mm = np.linalg.norm(tips - plan.T_base_tip_center.translation, axis=1).max()
    if away_mm > OUT_OF_SEAT_MM:
        raise NotReachableError(
            "something is in the way between two poses, and the tip cannot leave its seat to go "
            "around it: choose a smaller cone, or clear the place"
        )
