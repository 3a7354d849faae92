"""Compute boundaries and maps of a scan by hand: the probe is where the tracker saw it."""

from dataclasses import fields, replace

import numpy as np

from rona_core.app.dependencies.base_reference import reference_of
from rona_core.app.dependencies.inputs import require_result, required
from rona_core.app.steps.acoustics.derivation import with_known_speed
from rona_core.app.steps.acoustics.inputs import HELD_PROBE, KNOWN_SPEED
from rona_core.app.steps.handheld.messages import CalibrateHandheldProbe, StartHandheldMapping
from rona_core.app.steps.maps.derivation import Survey, detect_survey
from rona_core.calibration.hand_eye.base_marker import MIN_FRAMES, mean_base
from rona_core.calibration.handheld.tracked_probe import SonoCalibration, calibrate_sono
from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.devices.pose_interpolation import InterpolatedPoses, interpolate_poses
from rona_core.devices.protocols import Cancel, Progress
from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import LATENCY_MS, SONO
from rona_core.errors import DegenerateGeometryError, RonaError, StepBlockedError
from rona_core.geometry.arrays import Bools, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.mapping.build_maps import LocatedDetection, build_maps
from rona_core.session.captures import SonoCapture
from rona_core.session.document import Derived, Session, SonoMaps
from rona_core.session.memo import remember
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import corrected

SIGNIFICANT_SIGMAS = 3.0  # a smaller delay is not significant
NOT_SEEN = 9  # flag of an A-scan at which the tracker did not see the probe


def sono_delay_s(session: Session) -> float:
    """Return by how much later than it was measured a frame of the tracker arrives, as known.

    The registration estimates by how much the tracker is later than the robot, whose joint angles
    are late themselves: a lower bound. What the maker states of the tracker counts where it is
    more.
    """
    stated_s = LATENCY_MS.get(session.setup.devices.tracker.profile, 0.0) / 1000.0
    tool = session.results.tool
    delay = None if tool is None else tool.value.delay
    if delay is None or delay.offset_s <= SIGNIFICANT_SIGMAS * delay.sigma_s:
        return stated_s
    return max(stated_s, delay.offset_s)


def posed_scans(session: Session, capture: SonoCapture) -> InterpolatedPoses:
    """Return where the marker was at the A-scans."""
    return _posed(capture, sono_delay_s(session))


@remember(4)  # captures never change
def _posed(capture: SonoCapture, delay_s: float) -> InterpolatedPoses:
    return interpolate_poses(capture.marker, capture.scans.times_s, delay_s=delay_s)


def hand_reference(session: Session, capture: SonoCapture) -> tuple[str, Pose, str]:
    """Return the frame that stands for ``base``, the tracker in it, and a sentence about it.

    Raises:
        StepBlockedError: the place of the tracker is unknown.
        StaleResultError: it has moved since the registration, and is not found again.
    """
    if session.results.tool is not None:
        found = reference_of(session, capture)
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


def hand_poses(session: Session) -> tuple[str, Poses] | None:
    """Return the frame that stands for ``base``, and the probe in it at each A-scan by hand.

    Where the tracker did not see the probe it is taken to be where it was seen nearest in time.
    None before the scan, and where the place of the tracker is unknown.
    """
    capture, made = session.captures.sono_scan, session.results.sono
    if capture is None or made is None:
        return None
    posed = posed_scans(session, capture)
    seen = np.flatnonzero(posed.known)
    if not len(seen):
        return None
    try:
        frame, T_base_tracker, _ = hand_reference(session, capture)
    except RonaError:
        return None
    poses: Poses = T_base_tracker @ posed.Ts_tracker_marker @ made.value.T_sonomarker_probe
    times = capture.scans.times_s
    nearest = np.abs(times[:, None] - times[seen][None]).argmin(axis=1)
    return frame, poses.select(nearest)


def spread(detection: Detection, known: Bools) -> Detection | None:
    """Return what was found at the A-scans that count, over all of them (n,); else None.

    Args:
        detection: Of as many A-scans as are known.
        known: At which of the n the tracker saw the probe.
    """
    if len(detection) != np.count_nonzero(known):
        return None
    return _spread(detection, known.tobytes())


@remember(4)
def _spread(detection: Detection, known: bytes) -> Detection:
    rows = np.frombuffer(known, dtype=np.bool_)
    wide = {}
    for part in fields(detection):
        values = getattr(detection, part.name)
        if isinstance(values, np.ndarray):
            held = np.zeros((len(rows), *values.shape[1:]), dtype=values.dtype)
            held[rows] = values
            wide[part.name] = held
    wide["flag"][~rows] = NOT_SEEN
    return replace(detection, **{name: readonly(values) for name, values in wide.items()})


def gathered(detection: Detection, known: Bools) -> Detection:
    """Return the part of a detection over all A-scans (n,) at which the probe was seen."""
    parts = {part.name: getattr(detection, part.name) for part in fields(detection)}
    kept = {n: readonly(v[known]) for n, v in parts.items() if isinstance(v, np.ndarray)}
    return replace(detection, **kept)


def derive_sono_mapping(
    session: Session, message: StartHandheldMapping, *, progress: Progress, cancel: Cancel
) -> dict[str, object]:
    """Return both results of a scan by hand: the boundaries are detected, then mapped."""
    found = derive_sono_detection(
        session, message, progress=lambda share: progress(0.7 * share), cancel=cancel
    )
    made = Derived(found, "", {}, {})
    session = session.with_result("sono_detection", made)
    maps = derive_sono_maps(
        session, message, progress=lambda share: progress(0.7 + 0.3 * share), cancel=cancel
    )
    return {"sono_detection": found, "sono_maps": maps}


def derive_sono_detection(
    session: Session, message: StartHandheldMapping, *, progress: Progress, cancel: Cancel
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
    excitation = session.setup.devices.probe.excitation
    scans, probe = _chosen(capture.scans, known), required(HELD_PROBE, session)
    survey = Survey(scans, Ts_tracker_probe, probe, excitation)
    return detect_survey(survey, message, progress=progress, cancel=cancel)


def derive_sono_maps(
    session: Session, message: StartHandheldMapping, *, progress: Progress, cancel: Cancel
) -> SonoMaps:
    """Map both boundaries; fuse the outer one with the pointer cloud where there is one.

    Boundaries that were set by hand take the place of those that were found. Where the robot is
    registered, a calibrated speed of sound holds here too: the bone is the same.

    Raises:
        StepBlockedError: the place of the tracker is unknown.
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
        detection = with_known_speed(detection, Ts_base_probe, KNOWN_SPEED.read(session), wanted)
    cloud = session.results.surface if frame == "base" else None
    maps = build_maps(
        LocatedDetection(detection, Ts_base_probe),
        None if cloud is None else cloud.value.points_base,
        cell_mm=message.cell_mm,
        probe=required(HELD_PROBE, session),
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
    probe = required(HELD_PROBE, session)
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
