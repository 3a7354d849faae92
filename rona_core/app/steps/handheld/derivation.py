"""Compute boundaries and maps of a scan by hand: the probe is where the tracker saw it."""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.app.dependencies.inputs import require_result
from rona_core.app.steps.acoustics.derivation import session_probe, with_known_speed
from rona_core.app.steps.handheld.messages import CalibrateHandheldProbe, StartHandheldMapping
from rona_core.app.steps.handheld.scans import (
    gathered,
    hand_reference,
    posed_scans,
    sono_delay_s,
    spread,
)
from rona_core.app.steps.maps.derivation import Survey, detect_survey
from rona_core.calibration.handheld.tracked_probe import SonoCalibration, calibrate_sono
from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import SONO
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools
from rona_core.geometry.pose import Poses
from rona_core.mapping.build_maps import LocatedDetection, build_maps
from rona_core.session.document import Derived, Session, SonoMaps
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import corrected


@dataclass(frozen=True, slots=True)
class SonoMapped:
    """Both results of a scan by hand; their names are those of the session."""

    sono_detection: Detection
    sono_maps: SonoMaps


def derive_sono_mapping(
    session: Session,
    message: StartHandheldMapping,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> SonoMapped:
    """Detect the boundaries, then map them."""
    found = derive_sono_detection(
        session, message, progress=lambda share: progress(0.7 * share), cancel=cancel
    )
    made = Derived(found, "", {}, {})
    session = replace(session, results=replace(session.results, sono_detection=made))
    maps = derive_sono_maps(
        session, message, progress=lambda share: progress(0.7 + 0.3 * share), cancel=cancel
    )
    return SonoMapped(found, maps)


def derive_sono_detection(
    session: Session,
    message: StartHandheldMapping,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Detection:
    """Find both boundaries in the A-scans at which the tracker saw the probe.

    Raises:
        DegenerateGeometryError: it saw it at none.
    """
    capture = require_result(session.captures.sono_scan, "scan by hand")
    calibration = require_result(session.results.sono, "calibrate the SonoPointer").value
    posed = posed_scans(session, capture)
    known = posed.known
    if not known.any():
        raise DegenerateGeometryError(
            f"the tracker saw the probe at none of the {len(known)} A-scans: uncover its markers, "
            "and turn them towards the tracker"
        )
    Ts_tracker_probe: Poses = posed.Ts_tracker_marker @ calibration.T_sonomarker_probe
    survey = Survey(_chosen(capture.scans, known), Ts_tracker_probe)
    return detect_survey(session, survey, message, progress=progress, cancel=cancel)


def derive_sono_maps(
    session: Session,
    message: StartHandheldMapping,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> SonoMaps:
    """Map both boundaries; fuse the outer one with the pointer cloud where there is one.

    Boundaries that were set by hand take the place of those that were found. Where the robot is
    registered, a calibrated speed of sound holds here too: the bone is the same.

    Raises:
        StepBlockedError: nothing tells where the tracker stood.
        StaleResultError: it has moved since the registration, and is not found again.
    """
    capture = require_result(session.captures.sono_scan, "scan by hand")
    detection = require_result(session.results.sono_detection, "detect the boundaries").value
    calibration = require_result(session.results.sono, "calibrate the SonoPointer").value
    posed = posed_scans(session, capture)
    detection = _with_hand(session, detection, posed.known)
    frame, T_base_tracker, sentence = hand_reference(session, capture)
    Ts_base_probe: Poses = T_base_tracker @ posed.Ts_tracker_marker @ calibration.T_sonomarker_probe
    if frame == "base":
        wanted = message.sound_speed_mm_per_us
        detection = with_known_speed(detection, Ts_base_probe, session, wanted)
    cloud = session.results.surface if frame == "base" else None
    maps = build_maps(
        LocatedDetection(detection, Ts_base_probe),
        None if cloud is None else cloud.value.points_base,
        cell_mm=message.cell_mm,
        probe=session_probe(session),
        progress=progress,
        cancel=cancel,
    )
    return SonoMaps(
        maps=maps,
        frame="base" if frame == "base" else "basemarker",
        n_scans=len(capture.scans),
        n_posed=int(np.count_nonzero(posed.known)),
        delay_s=sono_delay_s(session),
        sentence=sentence,
    )


def _with_hand(session: Session, detection: Detection, known: Bools) -> Detection:
    """Return a detection with what was set by hand in its place."""
    whole = spread(detection, known)
    if whole is None or not len(session.boundary_edits.of("hand")):
        return detection
    probe = session_probe(session)
    return gathered(corrected(whole, session.boundary_edits, "hand", probe), known)


def _chosen(scans: AScanTrack, rows: Bools) -> AScanTrack:
    return replace(
        scans, times_s=scans.times_s[rows], rf=scans.rf[rows], clipped=scans.clipped[rows]
    )


def derive_sono(session: Session, message: CalibrateHandheldProbe) -> SonoCalibration:
    """Calibrate the probe in the hand from its pivoting and its turning.

    Raises:
        InvalidInputError: the tracker saw it in too few frames.
        DegenerateGeometryError: the motions tell too little.
    """
    pivot = require_result(session.captures.sono_pivot, "pivot the SonoPointer")
    spin = require_result(session.captures.sono_spin, "turn the SonoPointer about its axis")
    return calibrate_sono(
        pivot.marker.Ts_tracker_marker,
        spin.marker.Ts_tracker_marker,
        pointer=SONO,
        positions_marker=GEOMETRIES[SONO].positions_marker,
    )
