"""The A-scans of a scan by hand, numbered as they were taken: where the probe was, and what counts.

Boundaries are looked for only where the tracker saw the probe. For the eye, and for corrections,
what was found is spread over all A-scans again; at the others nothing counts.
"""

from dataclasses import fields, replace

import numpy as np

from rona_core.app.dependencies.base_reference import reference_of
from rona_core.calibration.hand_eye.base_marker import MIN_FRAMES, mean_base
from rona_core.devices.pose_interpolation import InterpolatedPoses, interpolate_poses
from rona_core.devices.settings import LATENCY_MS
from rona_core.errors import RonaError, StepBlockedError
from rona_core.geometry.arrays import Bools, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.captures import SonoCapture
from rona_core.session.document import Session
from rona_core.session.memo import remember
from rona_core.ultrasound.detection.detect import Detection

TOLD_SIGMAS = 3.0  # a delay smaller than this cannot be told from none
NOT_SEEN = 9  # flag of an A-scan at which the tracker did not see the probe


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


def posed_scans(session: Session, capture: SonoCapture) -> InterpolatedPoses:
    """Return where the marker was at the A-scans."""
    return _posed(capture, sono_delay_s(session))


@remember(4)  # captures never change
def _posed(capture: SonoCapture, delay_s: float) -> InterpolatedPoses:
    return interpolate_poses(capture.marker, capture.scans.times_s, delay_s=delay_s)


def hand_reference(session: Session, capture: SonoCapture) -> tuple[str, Pose, str]:
    """Return the frame that stands for ``base``, the tracker in it, and a sentence about it.

    Raises:
        StepBlockedError: nothing tells where the tracker stood.
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
    None before the scan, and where nothing tells where the tracker stood.
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
