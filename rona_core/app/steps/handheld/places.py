"""Where the probe was in a scan by hand: the tracker saw it, from a place that has to be known."""

import numpy as np

from rona_core.app.dependencies.references import Registered
from rona_core.calibration.hand_eye.reference_markers import MIN_FRAMES, mean_base
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.tracked_probe import SonoCalibration
from rona_core.calibration.timing.time_offset import tracker_delay_s
from rona_core.devices.samples import InterpolatedPoses, interpolate_poses
from rona_core.devices.settings import LATENCY_MS, TrackerProfile
from rona_core.errors import RonaError, StepBlockedError
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.captures import SonoCapture
from rona_core.session.memo import remember


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
