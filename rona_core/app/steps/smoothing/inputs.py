"""Inputs of the smoothed path."""

from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.steps.path.inputs import DEMONSTRATED, OF_REGISTRATION, PATH, VIEWPOINT
from rona_core.app.steps.path.painting import PAINTED
from rona_core.app.steps.surface.inputs import SURFACE
from rona_core.geometry.arrays import Vector3
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.path.manual_edits import PathEdits
from rona_core.path.zones import PaintedRegions
from rona_core.session.captures import PointerCapture
from rona_core.session.document import RawPath

EDITS = Input(lambda s: s.path_edits, "smooth the path (step 6)")


@inputs(
    implied=("demonstration", "strokes", "tool", *OF_REGISTRATION),
    free=("use of the base marker",),
)
class SmoothingInputs:
    """What the path is smoothed from."""

    path: RawPath = given(PATH, "path")
    cloud: SurfaceCloud = given(SURFACE, "surface")
    edits: PathEdits = given(EDITS, "edits")
    painted: PaintedRegions | None = given(PAINTED, "painted regions")
    demonstrated: PointerCapture | None = given(DEMONSTRATED, "demonstration")  # None: a pattern
    viewpoint: Vector3 = given(VIEWPOINT)
