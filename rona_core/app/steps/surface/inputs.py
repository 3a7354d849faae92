"""Inputs of the surface of step 4, and what others take from it."""

from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.references import (
    REGISTERED,
    HeadReference,
    Registered,
    found_again,
    head_input,
)
from rona_core.app.dependencies.staleness import capture_input, result_input
from rona_core.app.steps.pointer.inputs import POINTER
from rona_core.app.steps.setup.inputs import CHOOSE_REFERENCE, REGION, SKULL
from rona_core.app.steps.tool.inputs import TOOL
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.session.captures import PointerCapture
from rona_core.session.document import RegionChoice
from rona_core.session.specimen import LoadedSkull, SimulatedSkull

Strokes = tuple[PointerCapture, ...]
SURFACE_CAPTURE: Input[Strokes] = capture_input("surface")
SURFACE: Input[SurfaceCloud] = result_input("surface")
# False where the tracker has moved and may not be found again; it counts for nothing else
REFERENCE = Input(lambda s: found_again(s, s.captures.surface), CHOOSE_REFERENCE)


@inputs(
    implied=("place of the tracker", "field of the tracker", "head"),
    free=("use of the base marker",),  # where it matters the reference changes
)
class SurfaceInputs:
    """What the point cloud is built from."""

    strokes: Strokes = given(SURFACE_CAPTURE, "capture")
    registered: Registered = given(REGISTERED)
    pointer: PointerCalibration = given(POINTER, "pointer")
    found_again: bool = given(REFERENCE, "reference")
    head: HeadReference | None = given(head_input("surface"), "head")


@inputs(implied=("tool", "strokes"))
class SkullInputs:
    """What a loaded skull is laid under."""

    cloud: SurfaceCloud = given(SURFACE, "surface")
    skull: SimulatedSkull | LoadedSkull = given(SKULL, "skull")
    region: RegionChoice = given(REGION, "region")
    tool: ToolRegistration = given(TOOL, "tool")
    strokes: Strokes = given(SURFACE_CAPTURE, "strokes")
