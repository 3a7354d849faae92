"""A scan by hand: the probe is where the tracker saw it; boundaries and maps follow from that."""

import numpy as np

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.references import ANY_REGISTERED, Registered, found_again
from rona_core.app.dependencies.staleness import capture_input, result_input
from rona_core.app.steps.acoustics.derivation import HELD_PROBE, KNOWN_SPEED, with_known_speed
from rona_core.app.steps.handheld.messages import CalibrateHandheldProbe, StartHandheldMapping
from rona_core.app.steps.maps.derivation import Survey, detect_survey
from rona_core.app.steps.setup.capture_parts import HAND_PROBE, TRACKER_PROFILE, reference_input
from rona_core.calibration.hand_eye.reference_markers import MIN_FRAMES, mean_base
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.tracked_probe import SonoCalibration, calibrate_sono
from rona_core.calibration.timing.time_offset import tracker_delay_s
from rona_core.devices.protocols import Cancel, Progress
from rona_core.devices.samples import InterpolatedPoses, interpolate_poses
from rona_core.devices.settings import LATENCY_MS, SONO, ProbeSettings, TrackerProfile
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError, RonaError, StepBlockedError
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.mapping.build_maps import LocatedDetection, build_maps
from rona_core.session.captures import PointerCapture, SonoCapture
from rona_core.session.document import SonoMaps
from rona_core.session.memo import remember
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits, corrected
from rona_core.ultrasound.detection.seen_scans import gathered, spread
from rona_core.ultrasound.probe.probe_model import ProbeModel


def delay_of(tracker: TrackerProfile, tool: ToolRegistration | None) -> float:
    """Return by how many seconds later than it was measured a frame of the tracker arrives."""
    stated_s = LATENCY_MS.get(tracker, 0.0) / 1000.0
    return tracker_delay_s(stated_s, None if tool is None else tool.delay)


@remember(4)  # captures never change
def posed_scans(capture: SonoCapture, delay_s: float) -> InterpolatedPoses:
    """Return where the marker was at the A-scans."""
    return interpolate_poses(capture.marker, capture.scans.times_s, delay_s=delay_s)


def hand_reference(capture: SonoCapture, registered: Registered | None) -> tuple[str, Pose, str]:
    """Return the frame that stands for ``base``, the tracker in it, and a sentence about it.

    Raises:
        StepBlockedError: the place of the tracker is unknown.
        StaleResultError: it has moved since the registration, and is not found again.
    """
    if registered is not None:
        found = registered.reference(capture)
        return "base", found.T_base_tracker, f"In the robot's base. {found.sentence}"
    track = capture.base
    if track is None or len(track.times_s) < MIN_FRAMES:
        raise StepBlockedError(
            "the scan by hand cannot be mapped: without the robot (step 2) the base marker is the "
            "reference, and the tracker did not see it; uncover it and scan again"
        )
    T_basemarker_tracker = mean_base(track.Ts_tracker_marker).T_tracker_basemarker.inv()
    words = "In the frame of the base marker: no robot has been registered."
    return "basemarker", T_basemarker_tracker, words


def hand_poses(
    capture: SonoCapture,
    posed: InterpolatedPoses,
    calibration: SonoCalibration,
    registered: Registered | None,
) -> tuple[str, Poses] | None:
    """Return the frame that stands for ``base``, and the probe in it at each A-scan by hand.

    Where the tracker did not see the probe it is taken to be where it was seen nearest in time.
    None where it saw it nowhere, and where the place of the tracker is unknown.
    """
    seen = np.flatnonzero(posed.known)
    if not len(seen):
        return None
    try:
        frame, T_base_tracker, _ = hand_reference(capture, registered)
    except RonaError:
        return None
    poses: Poses = T_base_tracker @ posed.Ts_tracker_marker @ calibration.T_sonomarker_probe
    times = capture.scans.times_s
    nearest = np.abs(times[:, None] - times[seen][None]).argmin(axis=1)
    return frame, poses.select(nearest)


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


def calibrate_held_probe(
    known: HandCalibrationInputs, message: CalibrateHandheldProbe
) -> SonoCalibration:
    """Calibrate the probe in the hand from its pivoting and its turning.

    Raises:
        InvalidInputError: the tracker saw it in too few frames.
        DegenerateGeometryError: the motions tell too little.
    """
    return calibrate_sono(
        known.pivot.marker.Ts_tracker_marker,
        known.spin.marker.Ts_tracker_marker,
        pointer=SONO,
        positions_marker=GEOMETRIES[SONO].positions_marker,
    )


def find_boundaries_by_hand(
    known: HandSurvey, message: StartHandheldMapping, *, progress: Progress, cancel: Cancel
) -> Detection:
    """Find both boundaries in the A-scans at which the tracker saw the probe.

    Raises:
        DegenerateGeometryError: it saw it at none.
    """
    seen = known.posed.known
    if not seen.any():
        raise DegenerateGeometryError(
            f"the tracker saw the probe at none of the {len(seen)} A-scans: uncover its markers, "
            "and turn them towards the tracker"
        )
    mounted = known.calibration.T_sonomarker_probe
    Ts_tracker_probe: Poses = known.posed.Ts_tracker_marker @ mounted
    scans, excitation = known.scan.scans.part(seen), known.settings.excitation
    survey = Survey(scans, Ts_tracker_probe, known.probe, excitation)
    return detect_survey(survey, message, progress=progress, cancel=cancel)


def map_scan_by_hand(
    known: HandMapsInputs, message: StartHandheldMapping, *, progress: Progress, cancel: Cancel
) -> SonoMaps:
    """Map both boundaries; fuse the outer one with the pointer cloud where there is one.

    Boundaries that were set by hand take the place of those that were found. Where the robot is
    registered, a calibrated speed of sound holds here too: the bone is the same.

    Raises:
        StepBlockedError: the place of the tracker is unknown.
        StaleResultError: it has moved since the registration, and is not found again.
    """
    posed, detection = known.posed, _with_edits(known)
    frame, T_base_tracker, sentence = hand_reference(known.scan, known.registered)
    mounted = known.calibration.T_sonomarker_probe
    Ts_base_probe: Poses = T_base_tracker @ posed.Ts_tracker_marker @ mounted
    if frame == "base":
        wanted = message.sound_speed_mm_per_us
        detection = with_known_speed(detection, Ts_base_probe, known.speed, wanted)
    cloud = known.cloud if frame == "base" else None
    maps = build_maps(
        LocatedDetection(detection, Ts_base_probe),
        None if cloud is None else cloud.points_base,
        cell_mm=message.cell_mm,
        probe=known.probe,
        progress=progress,
        cancel=cancel,
    )
    return SonoMaps(
        maps=maps,
        frame="base" if frame == "base" else "basemarker",
        n_scans=len(known.scan.scans),
        n_posed=int(np.count_nonzero(posed.known)),
        delay_s=known.delay_s,
        sentence=sentence,
    )


def _with_edits(known: HandMapsInputs) -> Detection:
    """Return the detection with what was set by hand in its place."""
    whole = spread(known.detection, known.posed.known)
    if whole is None or not len(known.edits):
        return known.detection
    return gathered(corrected(whole, known.edits, "hand", known.probe), known.posed.known)
