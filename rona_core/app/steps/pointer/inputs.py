"""Inputs of the calibration of the pointer, and what others take from it."""

from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.inputs import capture_input, result_input
from rona_core.app.steps.setup.inputs import TRACKER_FIELD
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.tracker_field import TrackerErrorField
from rona_core.session.captures import PointerCapture

POINTER_CAPTURE: Input[PointerCapture] = capture_input("pointer")
POINTER: Input[PointerCalibration] = result_input("pointer")


@inputs(implied=("field of the tracker",))
class PointerInputs:
    """What the tip of the pointer is calibrated from."""

    capture: PointerCapture = given(POINTER_CAPTURE, "capture")
    field: TrackerErrorField = given(TRACKER_FIELD, "field of the tracker")
