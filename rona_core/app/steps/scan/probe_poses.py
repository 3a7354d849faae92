"""The pose of the probe at the instant of each A-scan: joint angles arrive later than echoes."""

import numpy as np

from rona_core.calibration.timing.robot_latency import (
    EchoSegment,
    PoseDelay,
    estimate_pose_delay,
    segment_places,
)
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.captures import ScanCapture
from rona_core.session.document import Session
from rona_core.session.memo import remember
from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model

MARGIN_S = 0.3  # joint angles so long before and after a segment belong to it


def probe_poses_of(session: Session, taken: ScanCapture | None = None) -> Poses | None:
    """Return the pose of the probe in ``base`` at the instant of each A-scan; None before a scan.

    Joint angles are looked up later by the delay that the first scan shows: in a second one the
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
    model = robot_model(session.setup.devices.robot.model)
    return model.forward(capture.joints.at(capture.scans.times_s + delay_s)) @ model.T_flange_probe


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
    found = detect(ProbeSurvey(scans, probe_model(probe), probe.excitation))
    probes = model.forward(capture.joints.qs_rad) @ model.T_flange_probe
    times = capture.joints.times_s
    middle_s = _middle(capture)
    segments: list[EchoSegment] = []
    for side in (scans.times_s <= middle_s, scans.times_s > middle_s):
        ok = side & found.outer_ok
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
