"""Burr: the tip of the spindle registered in a seat, before a bed is laid and milled."""

import numpy as np

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Remedy
from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.judge import by_verdict, judge_part
from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.runtime.handling import compute_result, record
from rona_core.app.steps.implant.burr.derivation import (
    BURR_CAPTURE,
    BurrRegistration,
    register_burr,
)
from rona_core.app.steps.implant.burr.messages import RegisterBurr, StartBurrCapture
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.app.steps.tool.robot_motion import record_tool_motion
from rona_core.devices.protocols import Motion, Robot
from rona_core.errors import NotReachableError
from rona_core.mapping.accuracy.probe_place import SEAT_MM
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


UNKNOWN = (
    f"Not registered: the burr may be off by {SEAT_MM:g} mm along each axis, so fewer beds fit."
)


def burr_words(session: Session) -> str:
    """Return what is known of the burr's tip, and whether it is used; empty if not registered."""
    held = session.results.get("burr")
    if held is None:
        return ""
    found: BurrRegistration = held.value
    x, y, z = found.offset_tip.tolist()
    words = (
        f"Tip {np.linalg.norm(found.offset_tip):.2f} mm off its drawing (x {x:+.2f}, y {y:+.2f}, "
        f"z {z:+.2f}), expected error "
        f"{FIGURES['burr_tip_sigma_mm'].words(found.tip_sigma_mm)}"
    )
    judgement = judge_part("burr", session)
    sentence = judgement.beside(words)
    return f"{sentence} The milling is corrected." if judgement.holds else sentence


STEP = declare.Step(
    "burr",
    part_of="implant",
    commands=(declare.Command(RegisterBurr, compute_result, needs=(BURR_CAPTURE, TOOL)),),
    activities=(
        declare.Activity(
            StartBurrCapture,
            record("burr", capture_burr, RegisterBurr),
            "Turning the burr in its seat",
            needs=(TOOL,),
            drives_robot=True,
            makes=("burr",),
        ),
    ),
    captures=(
        declare.Capture(
            "burr",
            "turn the burr in its seat (step 10)",
            (parts.tracker, parts.robot, parts.robot_errors, parts.SPINDLE),
            types=(ToolCapture,),
            done="the turning of the burr was recorded",
        ),
    ),
    results=(
        declare.Result.of(
            "burr",
            RegisterBurr,
            register_burr,
            "register the burr (step 10)",
            judged=by_verdict(
                Remedy("turn the burr in its seat again (step 10)", StartBurrCapture())
            ),
            done="the registration of the burr was computed",
        ),
    ),
)
