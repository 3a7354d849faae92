"""Inputs of detection, maps and plans of further passes."""

from dataclasses import dataclass

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.staleness import result_input, stale_reason
from rona_core.app.steps.acoustics.derivation import (
    ANY_AGAIN,
    DETECTION,
    KNOWN_SPEED,
    ROBOT_PROBE,
)
from rona_core.app.steps.path.inputs import PAINTED
from rona_core.app.steps.roll.inputs import DRIVEN, Driven
from rona_core.app.steps.scan.derivation import PLACES, PLACES_OF_ALL, POSES, SCAN, ProbePlaces
from rona_core.app.steps.scan.inputs import ANY_PASSES, PASSES, Passes
from rona_core.app.steps.setup.capture_parts import PROBE, TRACKER_PROFILE
from rona_core.app.steps.surface.derivation import SURFACE
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.devices.settings import ProbeSettings, TrackerProfile
from rona_core.geometry.pose import Poses
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.mapping.accuracy.probe_place import cloud_prior
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.cloud_fusion import CloudPrior
from rona_core.path.zones import PaintedRegions
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.captures import ScanCapture
from rona_core.session.document import SecondPass
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits, corrected
from rona_core.ultrasound.probe.probe_model import ProbeModel

MAPS: Input[Maps] = result_input("maps")
ROLL: Input[RobotPlan] = result_input("roll")
SECOND: Input[SecondPass] = result_input("second")

BY_HAND = "the correction of boundaries by hand (step 9)"
EDITS = Input(
    lambda s: s.boundary_edits.without("hand"),
    "scan (step 8)",
    title=BY_HAND,
)
FIRST_EDITS = Input(
    lambda s: s.boundary_edits.of("first"),
    "scan (step 8)",
    title=BY_HAND,
)
OUTER_EDITS = Input(
    lambda s: s.boundary_edits.of("first", "outer"),
    "scan (step 8)",
    title=BY_HAND,
)
FURTHER_EDITS = Input(
    lambda s: s.boundary_edits.of("second"),
    "scan (step 8)",
    title=BY_HAND,
)


ANY_PLAN: Input[SecondPass] = Input(
    lambda s: None if stale_reason("second", s) else SECOND.read(s),
    "plan a further pass",
    optional=True,
    part="second",
)


def _cloud_prior(
    tracker: TrackerProfile, tool: ToolRegistration | None, pointer: PointerCalibration | None
) -> CloudPrior:
    return cloud_prior(
        tracker,
        0.0 if tool is None else tool.registration_sigma_mm,
        0.0 if pointer is None else pointer.tip_sigma_mm,
    )


CLOUD_PRIOR: Quantity[CloudPrior] = Quantity(
    _cloud_prior,
    {
        "tracker": TRACKER_PROFILE,
        "registered tool": result_input("tool", optional=True),
        "calibrated pointer": result_input("pointer", optional=True),
    },
)
OF_CLOUD = ("tracker", "registered tool", "calibrated pointer")  # the cloud changes with them


@dataclass(frozen=True, slots=True, eq=False)
class FirstPass:
    """What the outer map is made of: boundaries (n) of the first pass, and the pointer's cloud."""

    found: Detection  # as detected
    detection: Detection  # with what was set by hand in its place
    poses: Poses  # (n,) of the probe in ``base``
    probe: ProbeModel
    cloud: SurfaceCloud
    prior: CloudPrior


def _first_pass(
    found: Detection,
    edits: BoundaryEdits,
    scan: ScanCapture,
    places: ProbePlaces,
    probe: ProbeModel,
    cloud: SurfaceCloud,
    prior: CloudPrior,
) -> FirstPass:
    detection = corrected(found, edits, "first", probe)
    return FirstPass(found, detection, places.poses(scan), probe, cloud, prior)


def _first_pass_of(
    edits: Input[BoundaryEdits], places: Quantity[ProbePlaces]
) -> Quantity[FirstPass]:
    parts = {
        "detection": DETECTION,
        "correction by hand": edits,
        "capture": SCAN,
        "places": places,
        "probe": ROBOT_PROBE,
        "surface": SURFACE,
        "prior": CLOUD_PRIOR,
    }
    return Quantity(_first_pass, parts)


@inputs(implied=("robot",))
class FirstSurvey:
    """What boundaries of the first pass are detected in."""

    scan: ScanCapture = given(SCAN, "capture")
    settings: ProbeSettings = given(PROBE, "probe")
    probe: ProbeModel = given(ROBOT_PROBE)
    poses: Poses = given(POSES)


@inputs(implied=("surface", *OF_CLOUD))
class FurtherSurvey:
    """What boundaries of further passes are detected in."""

    passes: Passes = given(PASSES, "capture")
    first: FirstPass = given(
        _first_pass_of(OUTER_EDITS, PLACES_OF_ALL), renamed={"capture": "scan"}
    )
    places: ProbePlaces = given(PLACES_OF_ALL, renamed={"capture": "scan"})
    settings: ProbeSettings = given(PROBE, "probe")


@inputs(
    implied=("probe", "line", "mounting", *OF_CLOUD),
    # a plan holds whatever passes follow it
    free=("second", "second_detection", "further correction", "plan"),
)
class TiltInputs:
    """What a further pass is planned with."""

    first: FirstPass = given(_first_pass_of(FIRST_EDITS, PLACES))
    passes: Passes = given(ANY_PASSES, "second")
    again: Detection | None = given(ANY_AGAIN, "second_detection")
    edits: BoundaryEdits = given(FURTHER_EDITS, "further correction")
    scan: ScanCapture = given(SCAN, "capture")
    places: ProbePlaces = given(PLACES)
    settings: ProbeSettings = given(PROBE, "probe")
    painted: PaintedRegions | None = given(PAINTED, "painted regions")
    driven: Driven = given(DRIVEN)
    searched: RobotPlan = given(ROLL, "roll")
    planned: SecondPass | None = given(ANY_PLAN, "plan")  # that is made again


@inputs(implied=("probe", "line", *OF_CLOUD))
class MapsInputs:
    """What both boundaries are mapped from."""

    first: FirstPass = given(_first_pass_of(EDITS, PLACES_OF_ALL))
    passes: Passes = given(ANY_PASSES, "second")
    again: Detection | None = given(ANY_AGAIN, "second_detection")
    edits: BoundaryEdits = given(EDITS, "correction by hand")
    places: ProbePlaces = given(PLACES_OF_ALL)
    speed: SpeedCalibration | None = given(KNOWN_SPEED, "speed")
