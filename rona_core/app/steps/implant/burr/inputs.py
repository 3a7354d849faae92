"""Inputs of the registration of the burr, and what others take from it."""

from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.judge import usable
from rona_core.app.dependencies.references import TRACKER_FIELD
from rona_core.app.dependencies.staleness import capture_input
from rona_core.app.steps.implant.burr.registration import BurrRegistration
from rona_core.app.steps.setup.capture_parts import MODEL, ROBOT_ERRORS
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.tracking_error import TrackerErrorField
from rona_core.session.captures import ToolCapture

BURR_CAPTURE: Input[ToolCapture] = capture_input("burr")
KNOWN_BURR: Input[BurrRegistration] = Input(
    lambda s: usable("burr", s), "register the burr (step 10)", optional=True, part="burr"
)


@inputs(implied=("errors of the robot", "field of the tracker"))
class BurrInputs:
    """What the tip of the burr is registered from."""

    capture: ToolCapture = given(BURR_CAPTURE, "capture")
    tool: ToolRegistration = given(TOOL, "tool")
    robot: str = given(MODEL, "robot")
    errors: bool = given(ROBOT_ERRORS, "errors of the robot")
    field: TrackerErrorField = given(TRACKER_FIELD, "field of the tracker")
