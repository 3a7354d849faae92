"""Tool: registration of tool, robot and tracker."""

from rona_core.app.declarations.declarations import (
    Activity,
    Capture,
    Command,
    Result,
    Step,
    StepLine,
)
from rona_core.app.dependencies.base_reference import placed_reason
from rona_core.app.dependencies.inputs import capture_input, result_input
from rona_core.app.dependencies.step_states import stopped_early
from rona_core.app.runtime.handling import compute_result
from rona_core.app.steps.setup.capture_parts import robot_errors_part, robot_part, tracker_part
from rona_core.app.steps.setup.inputs import MODEL
from rona_core.app.steps.tool.captures import record_tool
from rona_core.app.steps.tool.derivation import derive_registration
from rona_core.app.steps.tool.messages import RegisterTool, StartToolCapture
from rona_core.session.document import Session

TOOL_CAPTURE, TOOL = capture_input("tool"), result_input("tool")


def _summary(session: Session) -> str:
    held = session.results.tool
    if held is None:
        return ""
    return f"{held.value.n_poses} poses, random error {held.value.tip_sigma_mm:.2f} mm"


STEP = Step(
    "tool",
    commands=(Command(RegisterTool, compute_result, needs=(TOOL_CAPTURE,)),),
    activities=(
        Activity(
            StartToolCapture,
            record_tool,
            "Moving the tool",
            uses_devices=True,
            drives_robot=True,
            records=True,
        ),
    ),
    captures=(
        Capture(
            "tool",
            "record the tool motion (step 2)",
            (tracker_part, robot_part, robot_errors_part),
        ),
    ),
    results=(
        Result(
            "tool",
            RegisterTool,
            derive_registration,
            {"capture": TOOL_CAPTURE, "robot": MODEL},
            "register the tool (step 2)",
        ),
    ),
    line=StepLine(
        "Tool",
        _summary,
        StartToolCapture,
        leaves=lambda session: (TOOL_CAPTURE, TOOL),
        partial=lambda session: stopped_early("tool", session),
        stale=placed_reason,
    ),
)
