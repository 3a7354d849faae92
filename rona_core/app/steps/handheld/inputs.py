"""Inputs of the probe in the hand: its calibration, what it recorded, and where it was then."""

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.references import ANY_REGISTERED, Registered, found_again
from rona_core.app.dependencies.staleness import capture_input, result_input
from rona_core.app.steps.acoustics.derivation import HELD_PROBE, KNOWN_SPEED
from rona_core.app.steps.handheld.places import delay_of, hand_poses, posed_scans
from rona_core.app.steps.setup.capture_parts import HAND_PROBE, TRACKER_PROFILE, reference_input
from rona_core.calibration.handheld.tracked_probe import SonoCalibration
from rona_core.devices.samples import InterpolatedPoses
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.pose import Poses
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.session.captures import PointerCapture, SonoCapture
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits
from rona_core.ultrasound.probe.probe_model import ProbeModel

PIVOT: Input[PointerCapture] = capture_input("sono_pivot")
SPIN: Input[PointerCapture] = capture_input("sono_spin")
SCAN: Input[SonoCapture] = capture_input("sono_scan")
CALIBRATION: Input[SonoCalibration] = result_input("sono")
DETECTION: Input[Detection] = result_input("sono_detection")
ANY_SURFACE: Input[SurfaceCloud] = result_input("surface", optional=True)
EDITS = Input(
    lambda s: s.boundary_edits.of("hand"),
    "scan by hand (step 9)",
    title="the correction of boundaries by hand (step 9)",
)
# False where the tracker has moved and may not be found again; it counts for nothing else
REFERENCE = reference_input(lambda s: found_again(s, (s.captures.sono_scan,)))

DELAY: Quantity[float] = Quantity(
    delay_of, {"tracker": TRACKER_PROFILE, "tool": result_input("tool", optional=True)}
)
POSED: Quantity[InterpolatedPoses] = Quantity(posed_scans, {"capture": SCAN, "delay": DELAY})
HAND_POSES: Quantity[tuple[str, Poses]] = Quantity(
    hand_poses,
    {"capture": SCAN, "posed": POSED, "calibration": CALIBRATION, "registered": ANY_REGISTERED},
    optional=True,
)


@inputs()
class HandCalibrationInputs:
    """What the probe in the hand is calibrated from."""

    pivot: PointerCapture = given(PIVOT, "pivot")
    spin: PointerCapture = given(SPIN, "spin")


@inputs(implied=("tracker",))
class HandSurvey:
    """What boundaries of a scan by hand are detected in."""

    scan: SonoCapture = given(SCAN, "capture")
    calibration: SonoCalibration = given(CALIBRATION, "calibration")
    posed: InterpolatedPoses = given(POSED)
    settings: ProbeSettings = given(HAND_PROBE, "probe")
    probe: ProbeModel = given(HELD_PROBE)


@inputs(
    implied=("probe", "line", "tracker", "place of the tracker", "field of the tracker"),
    free=("use of the base marker",),  # where it matters the reference changes
)
class HandMapsInputs:
    """What the boundaries of a scan by hand are mapped from."""

    detection: Detection = given(DETECTION, "detection")
    edits: BoundaryEdits = given(EDITS, "correction by hand")
    calibration: SonoCalibration = given(CALIBRATION, "calibration")
    scan: SonoCapture = given(SCAN, "capture")
    delay_s: float = given(DELAY)
    posed: InterpolatedPoses = given(POSED)
    registered: Registered | None = given(ANY_REGISTERED)
    cloud: SurfaceCloud | None = given(ANY_SURFACE, "surface")
    found_again: bool = given(REFERENCE, "reference")
    speed: SpeedCalibration | None = given(KNOWN_SPEED, "speed")
    probe: ProbeModel = given(HELD_PROBE)
