"""Inputs of the calibration of the pointer, and what others take from it."""

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.references import TRACKER_FIELD
from rona_core.app.dependencies.staleness import capture_input, made_of, result_input
from rona_core.app.steps.pointer.touched_places import Evidence
from rona_core.app.steps.setup.inputs import MODEL, ROBOT_ERRORS
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.tracking_error import TrackerErrorField
from rona_core.session.captures import PointerCapture, ToolCapture

POINTER_CAPTURE: Input[PointerCapture] = capture_input("pointer")
POINTER: Input[PointerCalibration] = result_input("pointer")
_OF_TOOL: Input[ToolCapture] = Input(
    lambda s: s.captures.tool if made_of(s.results.tool, "capture", s.captures.tool) else None,
    "register the tool (step 2)",
    optional=True,
)
_OF_POINTER: Input[PointerCapture] = Input(
    lambda s: (
        s.captures.pointer if made_of(s.results.pointer, "capture", s.captures.pointer) else None
    ),
    "calibrate the pointer (step 3)",
    optional=True,
)
EVIDENCE: Quantity[Evidence] = Quantity(
    Evidence,
    {
        "robot": MODEL,
        "errors of the robot": ROBOT_ERRORS,
        "field of the tracker": TRACKER_FIELD,
        "capture of the tool": _OF_TOOL,
        "capture of the pointer": _OF_POINTER,
    },
)


@inputs(implied=("field of the tracker",))
class PointerInputs:
    """What the tip of the pointer is calibrated from."""

    capture: PointerCapture = given(POINTER_CAPTURE, "capture")
    field: TrackerErrorField = given(TRACKER_FIELD, "field of the tracker")
