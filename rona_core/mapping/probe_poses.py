"""The pose of the probe at the instant of each A-scan: joint angles arrive later than echoes."""

from dataclasses import dataclass

import numpy as np

from rona_core.calibration.timing.robot_latency import (
    LEAST_SCANS,
    EchoSegment,
    PoseDelay,
    estimate_pose_delay,
    segment_places,
)
from rona_core.devices.samples import AScanTrack, JointTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model

MARGIN_S = 0.3  # joint angles so long before and after a segment belong to it


@dataclass(frozen=True, slots=True, eq=False)
class ProbePostures:
    """Joint angles (n, 6) of the robot at the A-scans of a scan."""

    qs_rad: Floats


def probe_postures(joints: JointTrack, times_s: Floats, delay_s: float) -> ProbePostures:
    """Return the joint angles at A-scans taken at times (n,), which arrive later by ``delay_s``."""
    return ProbePostures(readonly(joints.at(times_s + delay_s)))


def face_poses(qs_rad: Floats, model: RobotModel, offset_mm: float, back: Poses | None) -> Poses:
    """Return the poses of the face of a probe in ``base``.

    Args:
        qs_rad: Postures (n, 6) of the robot.
        model: The robot.
        offset_mm: By which the face lies beyond its place in the drawing.
        back: Poses (n,) that undo the motion of the head since step 4; None: it lay still.
    """
    beyond = Pose.from_translation((0.0, 0.0, offset_mm))
    faces = model.forward(qs_rad) @ (model.T_flange_probe @ beyond)
    return faces if back is None else back @ faces


def pose_delay(
    joints: JointTrack,
    scans: AScanTrack,
    scan_times_s: Floats,
    model: RobotModel,
    probe: ProbeSettings,
) -> PoseDelay | None:
    """Return how late joint angles arrived in a scan; None where the A-scans do not show it.

    Args:
        joints: As they arrived.
        scans: A-scans of pressing on and lifting off.
        scan_times_s: Of the A-scans between (n,).
        model: The robot.
        probe: In its holder.
    """
    # the outer boundary alone counts: nothing need be learned of the bone
    found = detect(ProbeSurvey(scans, probe_model(probe), probe.excitation), bone_loss=1.0)
    probes, times = model.forward(joints.qs_rad) @ model.T_flange_probe, joints.times_s
    # between pressing on and lifting off
    middle_s = float(scan_times_s[len(scan_times_s) // 2]) if len(scan_times_s) else np.inf
    # gel is not as fast as the line, and not as thick as stated: pressed on, one speed holds
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
