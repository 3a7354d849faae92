"""Compute boundaries and maps of a scan by hand: the probe is where the tracker saw it."""

import numpy as np

from rona_core.app.steps.acoustics.derivation import with_known_speed
from rona_core.app.steps.handheld.inputs import HandCalibrationInputs, HandMapsInputs, HandSurvey
from rona_core.app.steps.handheld.messages import CalibrateHandheldProbe, StartHandheldMapping
from rona_core.app.steps.handheld.places import hand_reference
from rona_core.app.steps.maps.derivation import Survey, detect_survey
from rona_core.calibration.handheld.tracked_probe import SonoCalibration, calibrate_sono
from rona_core.devices.protocols import Cancel, Progress
from rona_core.devices.settings import SONO
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.pose import Poses
from rona_core.mapping.build_maps import LocatedDetection, build_maps
from rona_core.session.document import SonoMaps
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import corrected
from rona_core.ultrasound.detection.seen_scans import gathered, spread


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
