"""What the graphs and the replay show of a session: joint curves, an A-scan, the planned motion."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.derive_scan import probe_poses
from rona_core.arrays import Floats, readonly
from rona_core.devices.samples import AScan, AScanTrack
from rona_core.geometry.pose import Poses
from rona_core.robot.model import robot_model
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.ultrasound.detect import Detection
from rona_core.ultrasound.probe import probe_model
from rona_core.ultrasound.view import preview

SAME_PLACE_MM = 0.5  # places no farther apart count as the same one
BONE_US = 12.0  # two-way time in which the inner boundary is looked for, for the eye


@dataclass(frozen=True, slots=True, eq=False)
class AScanPlot:
    """One A-scan and what was found in it; times in µs from the emission."""

    number: int  # from 0
    time_us: Floats
    rf: Floats
    compressed: Floats  # envelope behind the matched filter, 1 at its largest
    behind_front: Floats  # the same without the front echo, 1 at its largest
    outer_us: float | None
    inner_us: float | None
    remark: str


def motion_times(session: Session) -> tuple[float, float, float] | None:
    """Return duration, start and end of the scan of the planned motion in s; None before."""
    searched = session.results.roll
    if searched is None or searched.value.trajectory is None:
        return None
    motion = searched.value.trajectory
    return float(motion.times_s[-1]), float(motion.scan_start_s), float(motion.scan_end_s)


def joints_at(session: Session, share: float) -> Floats | None:
    """Return the joint angles (6,) in rad at a share (0 to 1) of the planned motion."""
    searched = session.results.roll
    if searched is None or searched.value.trajectory is None:
        return None
    motion = searched.value.trajectory
    time_s = share * float(motion.times_s[-1])
    return np.array([np.interp(time_s, motion.times_s, q) for q in motion.qs_rad.T])


def path_percent_at(session: Session, share: float) -> float | None:
    """Return how far along the scan path (0 to 100) the planned motion is at a share of it."""
    searched = session.results.roll
    if searched is None or searched.value.trajectory is None:
        return None
    motion = searched.value.trajectory
    at_mm = float(np.interp(share * motion.times_s[-1], motion.times_s, motion.path_mm))
    return 100.0 * at_mm / max(float(motion.path_mm[-1]), 1e-9)


def scan_poses(session: Session) -> Poses | None:
    """Return where the probe was at each A-scan, in ``base``; None before the scan."""
    capture = session.captures.scan
    if capture is None or not len(capture.scans):
        return None
    return probe_poses(session)


def scan_number_at(session: Session, share: float) -> int | None:
    """Return the number of the A-scan taken nearest to where the planned motion is at a share.

    A scan in contact keeps its own time; of A-scans at the same place, where the path crosses
    itself, the one is taken that was as far along the scan as the motion is.
    """
    q_rad, poses, times = joints_at(session, share), scan_poses(session), motion_times(session)
    searched, capture = session.results.roll, session.captures.scan
    if q_rad is None or poses is None or times is None or searched is None or capture is None:
        return None
    model = robot_model(searched.value.model)
    tip_base = (model.joint_poses(q_rad)[-1] @ model.T_flange_probe).translation
    away_mm = np.linalg.norm(poses.translations - tip_base, axis=1)
    near = np.flatnonzero(away_mm <= away_mm.min() + SAME_PLACE_MM)
    taken_s = capture.scans.times_s
    done = (taken_s - taken_s[0]) / max(float(np.ptp(taken_s)), 1e-9)
    now = (share * times[0] - times[1]) / max(times[2] - times[1], 1e-9)
    return int(near[np.argmin(np.abs(done[near] - now))])


def ascan_plot(session: Session, number: int | None, live: AScan | None = None) -> AScanPlot | None:
    """Return an A-scan for the graph: the live one if given, else that of the scan by its number.

    Each curve is a share of its own largest value.
    """
    if live is not None:
        track, number = AScanTrack.from_scans([live]), 0
        remark = f"Live, {live.time_s:.1f} s after the start."
    else:
        capture = session.captures.scan
        if capture is None or number is None or not 0 <= number < len(capture.scans):
            return None
        track = capture.scans
        remark = f"A-scan {number + 1} of {len(track)}"
    found = None if live is not None else detection_of_scan(session)
    probe = session.setup.devices.probe
    view = preview(track, number, probe_model(probe), probe.excitation, found)
    if found is not None:
        usable = view.inner_us is not None
        remark += f": bone {found.thickness_mm[number]:.2f} mm" if usable else ": not usable"
    return AScanPlot(
        number=number,
        time_us=view.time_us,
        rf=_share(view.rf),
        compressed=_share(np.interp(view.time_us, view.matched_us, view.matched)),
        behind_front=_behind(view.time_us, view.matched_us, view.behind_front, view.outer_us),
        outer_us=view.outer_us,
        inner_us=view.inner_us,
        remark=remark,
    )


def detection_of_scan(session: Session) -> Detection | None:
    """Return what was detected in the present scan; None if it was taken again since."""
    derived, scan = session.results.detection, session.captures.scan
    if derived is None or scan is None or derived.inputs.get("capture") != digest(scan):
        return None
    return derived.value


def _share(values: Floats) -> Floats:
    return readonly(values / max(float(np.abs(values).max(initial=0.0)), 1e-12))


def _behind(time_us: Floats, matched_us: Floats, behind: Floats, outer_us: float | None) -> Floats:
    """Return what is left without the front echo, as a share of its largest value in the bone."""
    values = np.interp(time_us, matched_us, behind)
    if outer_us is None:
        return _share(values)
    bone = (time_us > outer_us) & (time_us < outer_us + BONE_US)
    return readonly(np.clip(values / max(float(values[bone].max(initial=0.0)), 1e-12), 0.0, 1.0))
