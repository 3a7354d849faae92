"""Inputs of the verification on landmarks."""

from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.references import REGISTERED, Registered, found_again
from rona_core.app.dependencies.staleness import capture_input, result_input
from rona_core.app.steps.pointer.inputs import EVIDENCE, POINTER
from rona_core.app.steps.pointer.touched_places import Evidence
from rona_core.app.steps.scan.landmarks.capture import LandmarkCapture
from rona_core.app.steps.setup.inputs import CHOOSE_REFERENCE
from rona_core.app.steps.tool.inputs import TOOL
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.landmark_check import LandmarkCheck
from rona_core.session.document import Session

LANDMARKS_CAPTURE: Input[LandmarkCapture] = capture_input("landmarks")
CHECK: Input[LandmarkCheck] = result_input("landmarks", optional=True)


def _found_again(session: Session) -> bool:
    held = LANDMARKS_CAPTURE.read(session)
    return held is None or found_again(session, (held.stroke,))


@inputs(
    implied=(
        "robot",
        "errors of the robot",
        "place of the tracker",
        "field of the tracker",
        "capture of the tool",
        "capture of the pointer",
    ),
    free=("use of the base marker",),
)
class LandmarkInputs:
    """What tracker, pointer and robot are compared from."""

    capture: LandmarkCapture = given(LANDMARKS_CAPTURE, "capture")
    registered: Registered = given(REGISTERED)
    pointer: PointerCalibration = given(POINTER, "pointer")
    found_again: bool = given(Input(_found_again, CHOOSE_REFERENCE), "reference")
    evidence: Evidence = given(EVIDENCE)


@inputs()
class OverrideInputs:
    """What a verification is overridden for."""

    check: LandmarkCheck | None = given(CHECK, "landmarks")
    tool: ToolRegistration = given(TOOL, "tool")
    pointer: PointerCalibration = given(POINTER, "pointer")
