"""Inputs of the registration of tool, robot and tracker, and what others take from it."""

from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.references import TRACKER_FIELD
from rona_core.app.dependencies.staleness import capture_input, result_input
from rona_core.app.steps.setup.inputs import MODEL, ROBOT_ERRORS
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.tracking_error import TrackerErrorField
from rona_core.session.captures import ToolCapture

TOOL_CAPTURE: Input[ToolCapture] = capture_input("tool")
TOOL: Input[ToolRegistration] = result_input("tool")


@inputs(implied=("errors of the robot", "field of the tracker"))
class ToolInputs:
    """What tool, robot and tracker are registered from."""

    capture: ToolCapture = given(TOOL_CAPTURE, "capture")
    robot: str = given(MODEL, "robot")
    errors: bool = given(ROBOT_ERRORS, "errors of the robot")
    field: TrackerErrorField = given(TRACKER_FIELD, "field of the tracker")
