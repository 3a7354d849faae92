"""How sure the maps of a session are; nothing of it is stored.

It follows from what a session holds, so that maps of older files are as honest as new ones.
"""

from collections.abc import Mapping

from rona_core.app.declarations.inputs import Input, Quantity
from rona_core.app.dependencies.judge import judge
from rona_core.app.dependencies.references import HeadReference
from rona_core.app.dependencies.staleness import made_of, required, result_input
from rona_core.app.steps.acoustics.derivation import AGAIN, DETECTION, KNOWN_LINE
from rona_core.app.steps.acoustics.thickness_uncertainty import speed_of_maps
from rona_core.app.steps.maps.error_budget import ErrorBudget, error_budgets
from rona_core.app.steps.maps.inputs import CLOUD_PRIOR, EDITS, MAPS
from rona_core.app.steps.scan.derivation import HEAD, KNOWN_MOUNTING, PLACES, SCAN, ProbePlaces
from rona_core.app.steps.setup.capture_parts import MODEL, PROBE, TRACKER_PROFILE
from rona_core.app.steps.surface.derivation import SURFACE
from rona_core.calibration.hand_eye.reference_markers import HeadMotion
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.tracked_probe import SonoCalibration
from rona_core.devices.settings import ProbeSettings, TrackerProfile
from rona_core.errors import InvalidInputError, StaleResultError
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.mapping.accuracy.map_accuracy import (
    MapAccuracy,
    accuracy_of,
    accuracy_words,
    expected_rms_mm,
)
from rona_core.mapping.accuracy.map_draws import MapDraws, draw_maps
from rona_core.mapping.accuracy.map_terms import Cloud, MapSamples, MapTerms, map_terms
from rona_core.mapping.accuracy.probe_place import ProbePlace, hand_place, robot_place
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.cloud_fusion import CloudPrior
from rona_core.mapping.probe_poses import ProbePostures
from rona_core.session.captures import ScanCapture
from rona_core.session.document import Session, SonoMaps
from rona_core.session.memo import remember
from rona_core.ultrasound.acoustic_calibration.delay_line import DelayLine
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits, ScanName
from rona_core.ultrasound.probe.probe_model import probe_model

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
