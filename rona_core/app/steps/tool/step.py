"""Tool: registration of tool, robot and tracker."""

from dataclasses import replace

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Judgement, Remedy
from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.judge import by_verdict
from rona_core.app.dependencies.references import REMEDY, placed_reason
from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.runtime.handling import compute_result, record
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.tool.derivation import TOOL, TOOL_CAPTURE, register
from rona_core.app.steps.tool.messages import RegisterTool, StartToolCapture
from rona_core.app.steps.tool.robot_motion import record_tool_motion
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.calibration_motion import ToolMotionSettings, plan_tool_motion
from rona_core.session.captures import ToolCapture
from rona_core.session.document import Session

REGISTER_AGAIN = Remedy("register the tool again (step 2)", StartToolCapture())


def capture_tool(
    activity: StartToolCapture, session: Session, context: ActivityContext
) -> ToolCapture:
    """Record the tool marker and the joints while the robot pivots and translates the tool."""
    model = robot_model(session.setup.devices.robot.model)
    around = session_obstacles(session).without_touch()
    plan = plan_tool_motion(
        model,
        ToolMotionSettings(
            cone_deg=activity.cone_deg,
            n_pivot=activity.n_pivot,
            n_translate=activity.n_translate,
        ),
        obstacles=around,
    )
    return record_tool_motion("tool", plan, model, around, session, context)


def moved_tracker(session: Session) -> Judgement | None:
    """Return why new strokes could not be mapped after a move of the tracker; None where they can.

    What was recorded before the move stays valid.
    """
    reason = placed_reason(session)
    return (
        None
        if reason is None
        else Judgement("blocked", reason, replace(REGISTER_AGAIN, words=REMEDY))
    )


def _summary(session: Session) -> str:
    held = session.results.tool
    if held is None:
        return ""
    expected = FIGURES["tool_tip_sigma_mm"].words(held.value.tip_sigma_mm)
    return f"{held.value.n_poses} poses, expected error {expected}"


STEP = declare.Step(
    "tool",
    commands=(declare.Command(RegisterTool, compute_result, needs=(TOOL_CAPTURE,)),),
    activities=(
        declare.Activity(
            StartToolCapture,
            record("tool", capture_tool, RegisterTool),
            "Moving the tool",
            drives_robot=True,
            makes=("tool",),
        ),
    ),
    captures=(
        declare.Capture(
            "tool",
            "record the tool motion (step 2)",
            (parts.tracker, parts.robot, parts.robot_errors),
            done="the motion of the tool was recorded",
        ),
    ),
    results=(
        declare.Result.of(
            "tool",
            RegisterTool,
            register,
            "register the tool (step 2)",
            judged=by_verdict(REGISTER_AGAIN, used=True),
            done="the registration of the tool was computed",
        ),
    ),
    line=declare.StepLine(
        "Tool",
        _summary,
        StartToolCapture,
        leaves=lambda session: (TOOL_CAPTURE, TOOL),
        stale=placed_reason,
    ),
)
