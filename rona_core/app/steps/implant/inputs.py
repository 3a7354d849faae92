"""Inputs of the bed of step 10, of lines for it and of its milling."""

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.staleness import result_input
from rona_core.app.steps.acoustics.derivation import DETECTION
from rona_core.app.steps.implant.burr.inputs import KNOWN_BURR, BurrRegistration
from rona_core.app.steps.implant.implant_bed import ImplantBed
from rona_core.app.steps.implant.milling_plan import MillingPlan
from rona_core.app.steps.maps.accuracy import OF_MAPS, TERMS
from rona_core.app.steps.maps.inputs import MAPS
from rona_core.app.steps.path.inputs import PAINTED
from rona_core.app.steps.setup.capture_parts import MODEL, OBSTACLES
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.mapping.accuracy.map_terms import MapTerms
from rona_core.mapping.boundary_map import Maps
from rona_core.path.zones import PaintedRegions
from rona_core.planning.placement.problem import ExecutionError, execution_error
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.ultrasound.detection.detect import Detection

WANTED = "place the implant bed (step 10)"
BED: Input[ImplantBed] = result_input("bed")
MILLING: Input[MillingPlan] = result_input("milling")


def _execution_error(burr: BurrRegistration | None, robot: str) -> ExecutionError:
    return execution_error(robot, None if burr is None else burr.tip_sigma_mm)


EXECUTION: Quantity[ExecutionError] = Quantity(
    _execution_error, {"burr": KNOWN_BURR, "robot": MODEL}
)


@inputs(implied=OF_MAPS)
class BedInputs:
    """What a bed is laid in."""

    maps: Maps = given(MAPS, "maps")
    tool: ToolRegistration = given(TOOL, "tool")
    burr: BurrRegistration | None = given(KNOWN_BURR, "burr")
    execution: ExecutionError = given(EXECUTION)
    terms: MapTerms | None = given(TERMS)

    @property
    def burr_sigma_mm(self) -> float | None:
        """3D standard deviation of the registered tip of the burr; None: it was not registered."""
        return None if self.burr is None else self.burr.tip_sigma_mm


@inputs(implied=(*OF_MAPS, "painted regions"))
class LinesInputs:
    """What lines for a bed are found with."""

    bed: ImplantBed = given(BED, "bed")
    maps: Maps = given(MAPS, "maps")
    tool: ToolRegistration = given(TOOL, "tool")
    execution: ExecutionError = given(EXECUTION)
    terms: MapTerms | None = given(TERMS)
    detection: Detection = given(DETECTION, "detection")
    painted: PaintedRegions | None = given(PAINTED, "painted regions")


@inputs()
class MillingInputs:
    """What the milling of a bed is planned with."""

    bed: ImplantBed = given(BED, "bed")
    maps: Maps = given(MAPS, "maps")
    tool: ToolRegistration = given(TOOL, "tool")
    burr: BurrRegistration | None = given(KNOWN_BURR, "burr")
    robot: str = given(MODEL, "robot")
    obstacles: Obstacles = given(OBSTACLES, "obstacles")
