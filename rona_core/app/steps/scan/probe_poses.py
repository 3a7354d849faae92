"""The pose of the probe at the instant of each A-scan: joint angles arrive later than echoes."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.dependencies.head_reference import HeadWatch, watch_head
from rona_core.app.steps.scan.probe_mounting import known_mounting
from rona_core.calibration.timing.robot_latency import (
    LEAST_SCANS,
    EchoSegment,
    PoseDelay,
    estimate_pose_delay,
    segment_places,
)
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.captures import ScanCapture
from rona_core.session.document import Session
from rona_core.session.memo import remember
from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model

MARGIN_S = 0.3  # joint angles so long before and after a segment belong to it


def probe_poses_of(session: Session, taken: ScanCapture | None = None) -> Poses | None:
    """Return the pose of the probe in ``base`` at the instant of each A-scan; None before a scan.

    The face is where the gauge plate found it, or else where it should be. Where the head has moved
    since step 4, the poses are led back to how it lay then.

    Joint angles are looked up later by the delay that the first scan shows: in further ones the
    probe leans, and hardly hears the bone while it comes near.

    Args:
        session: Holds the first scan.
        taken: The scan that is meant; None: the first.
    """
    capture = session.captures.scan if taken is None else taken
    if capture is None:
        return None
    delay = pose_delay(session)
    delay_s = 0.0 if delay is None else delay.delay_s
    mounting = known_mounting(session)
    offset_mm = 0.0 if mounting is None else mounting.offset_mm
    watch = watch_head(session, capture)
    return _poses(capture, delay_s, session.setup.devices.robot.model, offset_mm, watch)


@dataclass(frozen=True, slots=True, eq=False)
class ProbePostures:
    """Joint angles (n, 6) of the robot at the A-scans of a scan."""

    qs_rad: Floats


def probe_postures_of(session: Session, taken: ScanCapture | None = None) -> ProbePostures | None:
    """Return the joint angles at the A-scans of a pass, by default the first; None before a scan.

    Arguments as of ``probe_poses_of``.
    """
    capture = session.captures.scan if taken is None else taken
    if capture is None:
        return None
    delay = pose_delay(session)
    return _postures(capture, 0.0 if delay is None else delay.delay_s)


@remember(16)
def _postures(capture: ScanCapture, delay_s: float) -> ProbePostures:
    return ProbePostures(readonly(capture.joints.at(capture.scans.times_s + delay_s)))


@remember(16)  # all scans; what is made of one set of poses is remembered with them
def _poses(
    capture: ScanCapture, delay_s: float, robot: str, offset_mm: float, watch: HeadWatch | None
) -> Poses:
    """Return the poses of the face of a probe that is ``offset_mm`` beyond its place."""
    model, beyond = robot_model(robot), Pose.from_translation((0.0, 0.0, offset_mm))
    nominal = model.forward(capture.joints.at(capture.scans.times_s + delay_s))
    faces = nominal @ (model.T_flange_probe @ beyond)
    back = None if watch is None else watch.back(capture.scans.times_s)
    return faces if back is None else back @ faces


def pose_delay(session: Session) -> PoseDelay | None:
    """Return how late joint angles arrived in the scan; None where nothing tells it."""
    capture = session.captures.scan
    if capture is None or capture.clock_scans is None:
        return None
    devices = session.setup.devices
    return _delay(capture, devices.robot.model, devices.probe)


@remember(2)  # captures never change, and several views ask
def _delay(capture: ScanCapture, robot: str, probe: ProbeSettings) -> PoseDelay | None:
    scans = capture.clock_scans
    if scans is None:
        return None
    model = robot_model(robot)
    # the outer boundary alone counts: nothing need be learned of the bone
    found = detect(ProbeSurvey(scans, probe_model(probe), probe.excitation), bone_loss=1.0)
    probes = model.forward(capture.joints.qs_rad) @ model.T_flange_probe
    times = capture.joints.times_s
    middle_s = _middle(capture)
    # gel is not as fast as the line, and not as thick as is told: pressed on, one speed holds
    counts = found.outer_ok & (found.standoff_mm < 0.0)
    if np.count_nonzero(counts) < LEAST_SCANS:
        counts = found.outer_ok
    segments: list[EchoSegment] = []
    for side in (scans.times_s <= middle_s, scans.times_s > middle_s):
        ok = side & counts
        if np.count_nonzero(ok) < 2:
            continue
        at: Floats = scans.times_s[ok]
        inside = (times >= at[0] - MARGIN_S) & (times <= at[-1] + MARGIN_S)
        if np.count_nonzero(inside) < 4:
            continue
        near = int(np.argmin(np.abs(times[inside] - at[len(at) // 2])))
        axes = probes.rotations[inside, :, 2]
        place = segment_places(probes.translations[inside], axes, near)
        segments.append(EchoSegment(at, found.standoff_mm[ok], times[inside], place))
    try:
        return estimate_pose_delay(segments)
    except DegenerateGeometryError:
        return None


def _middle(capture: ScanCapture) -> float:
    """Return a time between pressing on and lifting off."""
    if len(capture.scans):
        return float(capture.scans.times_s[len(capture.scans) // 2])
    return float("inf")
