"""Inputs of detection, maps and further passes, and how sure the maps are.

How sure they are follows from what a session holds and is not stored, so that maps of older files
are as honest as new ones.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.judge import judge
from rona_core.app.dependencies.references import HeadReference
from rona_core.app.dependencies.staleness import made_of, required, result_input, stale_reason
from rona_core.app.steps.acoustics.derivation import (
    AGAIN,
    ANY_AGAIN,
    DETECTION,
    KNOWN_LINE,
    KNOWN_SPEED,
    ROBOT_PROBE,
)
from rona_core.app.steps.acoustics.view import speed_of_maps
from rona_core.app.steps.maps.error_budget import ErrorBudget, error_budgets
from rona_core.app.steps.path.inputs import PAINTED
from rona_core.app.steps.roll.inputs import DRIVEN, Driven
from rona_core.app.steps.scan.derivation import (
    HEAD,
    KNOWN_MOUNTING,
    PLACES,
    PLACES_OF_ALL,
    POSES,
    SCAN,
    ProbePlaces,
)
from rona_core.app.steps.scan.inputs import ANY_PASSES, PASSES, Passes
from rona_core.app.steps.setup.capture_parts import MODEL, PROBE, TRACKER_PROFILE
from rona_core.app.steps.surface.derivation import SURFACE
from rona_core.calibration.hand_eye.reference_markers import HeadMotion
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.handheld.tracked_probe import SonoCalibration
from rona_core.devices.settings import ProbeSettings, TrackerProfile
from rona_core.errors import InvalidInputError, StaleResultError
from rona_core.geometry.pose import Poses
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.mapping.accuracy.map_accuracy import (
    MapAccuracy,
    accuracy_of,
    accuracy_words,
    expected_rms_mm,
)
from rona_core.mapping.accuracy.map_draws import MapDraws, draw_maps
from rona_core.mapping.accuracy.map_terms import Cloud, MapSamples, MapTerms, map_terms
from rona_core.mapping.accuracy.probe_place import ProbePlace, cloud_prior, hand_place, robot_place
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.cloud_fusion import CloudPrior
from rona_core.mapping.probe_poses import ProbePostures
from rona_core.path.zones import PaintedRegions
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.captures import ScanCapture
from rona_core.session.document import SecondPass, Session, SonoMaps
from rona_core.session.memo import remember
from rona_core.ultrasound.acoustic_calibration.delay_line import DelayLine
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits, ScanName, corrected
from rona_core.ultrasound.probe.probe_model import ProbeModel, probe_model

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


MOST_DRAWS = 1000

SONO_MAPS: Input[SonoMaps] = result_input("sono_maps")
HELD_AGAIN: Input[Detection] = Input(
    AGAIN.read, "detect the boundaries", optional=True, part="second_detection"
)
SPEED_OF_MAPS: Input[SpeedCalibration] = Input(
    speed_of_maps, "calibrate the speed (step 9)", optional=True, part="speed"
)
SPEED_BY_HAND: Input[SpeedCalibration] = Input(
    lambda s: speed_of_maps(s, hand=True),
    "calibrate the speed (step 9)",
    optional=True,
    part="speed",
)


def _cloud_of_maps(session: Session) -> SurfaceCloud | None:
    """Return the cloud that the maps were fused with; None where the session has another one."""
    cloud = SURFACE.read(session)
    return cloud if cloud and made_of(session.results.maps, "surface", cloud) else None


CLOUD_OF_MAPS: Input[SurfaceCloud] = Input(
    _cloud_of_maps, "sample the surface (step 4)", optional=True, part="surface"
)

# maps never change, and every browser reads them
_hand_place = remember(4)(hand_place)
_map_terms, _accuracy = remember(2)(map_terms), remember(4)(accuracy_of)


def _postures(scan: ScanCapture, places: ProbePlaces) -> ProbePostures:
    return places.postures(scan)


def _line_sigma_us(probe: ProbeSettings, line: DelayLine | None) -> float | None:
    return None if line is None else line.at(probe.line_temperature_c)[1]


def _head_motion(scan: ScanCapture, head: HeadReference) -> HeadMotion | None:
    watch = head.watch(scan)
    return None if watch is None else watch.motion


def _samples(
    first: Detection, again: Detection | None, edits: BoundaryEdits, probe: ProbeSettings
) -> MapSamples:
    found = (first,) if again is None else (first, again)
    scans: tuple[ScanName, ...] = ("first", "second")
    return MapSamples(found, scans[: len(found)], edits, probe)


def _cloud(cloud: SurfaceCloud | None, prior: CloudPrior) -> Cloud | None:
    return None if cloud is None else (cloud, prior)


def _hand_terms(
    made: SonoMaps,
    found: Detection,
    probe: ProbeSettings,
    speed: SpeedCalibration | None,
    tracker: TrackerProfile,
    calibration: SonoCalibration | None,
    tool: ToolRegistration | None,
) -> MapTerms | None:
    # boundaries set by hand are few, and are numbered by A-scans that the tracker may not see
    samples = MapSamples((found,), ("hand",), BoundaryEdits(), probe)
    face_mm = 0.0 if calibration is None else calibration.face_sigma_mm
    known_mm = 0.0 if tool is None else tool.registration_sigma_mm
    place = _hand_place(tracker, face_mm, known_mm if made.frame == "base" else None)
    return _map_terms(made.maps, samples, speed, place, None)


ROBOT_PLACE: Quantity[ProbePlace] = Quantity(
    remember(4)(robot_place),
    {
        "robot": MODEL,
        "postures": Quantity(_postures, {"capture": SCAN, "places": PLACES}),
        "model of the probe": Quantity(probe_model, {"probe": PROBE}),
        "mounting": KNOWN_MOUNTING,
        "delay": Quantity(_line_sigma_us, {"probe": PROBE, "line": KNOWN_LINE}, optional=True),
        "motion": Quantity(_head_motion, {"capture": SCAN, "head": HEAD}, optional=True),
    },
)
TERMS: Quantity[MapTerms] = Quantity(
    _map_terms,
    {
        "maps": MAPS,
        "samples": Quantity(
            _samples,
            {
                "detection": DETECTION,
                "detection of further passes": HELD_AGAIN,
                "correction by hand": EDITS,
                "probe": PROBE,
            },
        ),
        "speed of the maps": SPEED_OF_MAPS,
        "place": ROBOT_PLACE,
        "cloud": Quantity(
            _cloud, {"cloud of the maps": CLOUD_OF_MAPS, "prior": CLOUD_PRIOR}, optional=True
        ),
    },
    optional=True,  # None where the maps are of other A-scans
)
OF_MAPS = tuple(key for key in TERMS.inputs() if key != "maps")  # the maps change with them
HAND_TERMS: Quantity[MapTerms] = Quantity(
    _hand_terms,
    {
        "maps": SONO_MAPS,
        "detection": result_input("sono_detection"),
        "probe": PROBE,
        "speed": SPEED_BY_HAND,
        "tracker": TRACKER_PROFILE,
        "calibration": result_input("sono", optional=True),
        "tool": result_input("tool", optional=True),
    },
    optional=True,
)


def map_accuracy(session: Session, *, hand: bool = False) -> MapAccuracy | None:
    """Return how sure the maps are; None before there are any, or of other A-scans than these.

    Args:
        session: With its maps.
        hand: Those of the scan by hand, in place of the robot's.
    """
    terms = (HAND_TERMS if hand else TERMS).read(session)
    if terms is None:
        return None
    maps = required(SONO_MAPS, session).maps if hand else required(MAPS, session)
    return _accuracy(maps, terms)


def expected_map_errors(session: Session) -> dict[str, float]:
    """Return the expected RMS errors of maps and thickness, see `expected_rms_mm`; {} without."""
    accuracy = map_accuracy(session)
    return {} if accuracy is None else expected_rms_mm(required(MAPS, session), accuracy)


def accuracy_sentence(session: Session, *, hand: bool = False) -> str:
    """Return a sentence about the expected errors of the maps; empty where they are not known."""
    accuracy = map_accuracy(session, hand=hand)
    if accuracy is None:
        return ""
    maps = required(SONO_MAPS, session).maps if hand else required(MAPS, session)
    return accuracy_words(maps, accuracy)


def budgets(session: Session, figures: Mapping[str, object]) -> tuple[ErrorBudget, ...]:
    """Return the error budgets of the robot's maps; empty before there are any.

    Args:
        session: With its maps.
        figures: Of the session, with ground truth where it is known.
    """
    accuracy = map_accuracy(session)
    return () if accuracy is None else error_budgets(accuracy, figures)


def drawn_maps(
    session: Session,
    count: int,
    seed: int = 0,
    *,
    same_robot: bool = False,
    grooves: bool = False,
) -> MapDraws:
    """Return the robot's maps as they may be; arguments as of `draw_maps`.

    Raises:
        InvalidInputError: no draws, or too many.
        StepBlockedError: nothing was mapped.
        StaleResultError: the maps are out of date.
    """
    if not 1 <= count <= MOST_DRAWS:
        raise InvalidInputError(f"{count} draws are out of range: 1 to {MOST_DRAWS}")
    maps, found = required(MAPS, session), judge(MAPS, session)
    if not found.holds:
        raise StaleResultError(f"the maps are stale: {found.reason}")
    terms = TERMS.read(session)
    return draws_of(maps, terms, count, seed, same_robot=same_robot, grooves=grooves)


def draws_of(
    maps: Maps,
    terms: MapTerms | None,
    count: int,
    seed: int = 0,
    *,
    same_robot: bool = False,
    grooves: bool = False,
) -> MapDraws:
    """Return the robot's maps as they may be; arguments as of `draw_maps`.

    Raises:
        StaleResultError: there are no terms, as the maps are of other A-scans.
    """
    if terms is None:
        raise StaleResultError("the maps are stale: they are of other A-scans")
    return draw_maps(maps, terms, count, seed, same_robot=same_robot, grooves=grooves)
