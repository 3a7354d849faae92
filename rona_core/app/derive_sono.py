"""Compute boundaries and maps of a scan by hand: the probe is where the tracker saw it."""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.app.needs import need
from rona_core.app.sono_messages import StartSonoMapping
from rona_core.calibration.base_marker import MIN_FRAMES, mean_base
from rona_core.devices.pose_track import PosesAt, poses_at
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import LATENCY_MS
from rona_core.errors import DegenerateGeometryError, StepBlockedError
from rona_core.geometry.pose import Pose, Poses
from rona_core.mapping.build import build_maps
from rona_core.session.document import Derived, Session, SonoCapture, SonoMaps
from rona_core.session.reference import reference_of
from rona_core.ultrasound.detect import Detection, detect
from rona_core.ultrasound.probe import probe_model

TOLD_SIGMAS = 3.0  # a delay smaller than this cannot be told from none


@dataclass(frozen=True, slots=True)
class SonoMapped:
    """Both results of a scan by hand; their names are those of the session."""

    sono_detection: Detection
    sono_maps: SonoMaps


def derive_sono_mapping(
    session: Session,
    message: StartSonoMapping,
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
    message: StartSonoMapping,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Detection:
    """Find both boundaries in the A-scans at which the tracker saw the probe.

    Raises:
        DegenerateGeometryError: it saw it at none.
    """
    capture = need(session.captures.sono_scan, "scan by hand")
    known = _posed(session, capture).known
    if not known.any():
        raise DegenerateGeometryError(
            f"the tracker saw the probe at none of the {len(known)} A-scans: uncover its markers, "
            "and turn them towards the tracker"
        )
    probe = session.setup.devices.probe
    return detect(
        _chosen(capture.scans, known),
        probe_model(probe),
        probe.excitation,
        method=message.method,
        sound_speed_mm_per_us=message.sound_speed_mm_per_us,
        progress=progress,
        cancel=cancel,
    )


def derive_sono_maps(
    session: Session,
    message: StartSonoMapping,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> SonoMaps:
    """Map both boundaries; fuse the outer one with the pointer cloud where there is one.

    Raises:
        StepBlockedError: nothing tells where the tracker stood.
        StaleResultError: it has moved since the registration, and is not found again.
    """
    capture = need(session.captures.sono_scan, "scan by hand")
    detection = need(session.results.sono_detection, "detect the boundaries").value
    calibration = need(session.results.sono, "calibrate the SonoPointer").value
    posed = _posed(session, capture)
    frame, T_base_tracker, sentence = _reference(session, capture)
    Ts_tracker_probe: Poses = posed.Ts_tracker_marker @ calibration.T_sonomarker_probe
    cloud = session.results.surface if frame == "base" else None
    maps = build_maps(
        detection,
        T_base_tracker @ Ts_tracker_probe,
        None if cloud is None else cloud.value.points_base,
        cell_mm=message.cell_mm,
        probe=probe_model(session.setup.devices.probe),
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


def sono_delay_s(session: Session) -> float:
    """Return by how much later than it was measured a frame of the tracker arrives, as known.

    The registration tells by how much the tracker is later than the robot, whose joint angles are
    late themselves: a lower bound. What the maker states of the tracker counts where it is more.
    """
    stated_s = LATENCY_MS.get(session.setup.devices.tracker.profile, 0.0) / 1000.0
    tool = session.results.tool
    delay = None if tool is None else tool.value.delay
    if delay is None or delay.offset_s <= TOLD_SIGMAS * delay.sigma_s:
        return stated_s
    return max(stated_s, delay.offset_s)


def _posed(session: Session, capture: SonoCapture) -> PosesAt:
    """Return where the marker was at the A-scans."""
    return poses_at(capture.marker, capture.scans.times_s, delay_s=sono_delay_s(session))


def _chosen(scans: AScanTrack, rows: np.typing.NDArray[np.bool_]) -> AScanTrack:
    return replace(
        scans, times_s=scans.times_s[rows], rf=scans.rf[rows], clipped=scans.clipped[rows]
    )


def _reference(session: Session, capture: SonoCapture) -> tuple[str, Pose, str]:
    """Return the frame that stands for ``base``, the tracker in it, and a sentence about it."""
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
