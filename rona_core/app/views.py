"""What the graphs and the replay show of a session: joint curves, an A-scan, the planned motion."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.derive_scan import probe_poses
from rona_core.arrays import Floats, readonly
from rona_core.devices.samples import AScan, AScanTrack
from rona_core.geometry.pose import Poses
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.ultrasound.detect import Detection
from rona_core.ultrasound.probe import probe_model
from rona_core.ultrasound.view import preview

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
    """Return the number of the A-scan nearest to a share of the planned motion."""
    capture, times = session.captures.scan, motion_times(session)
    if capture is None or not len(capture.scans) or times is None:
        return None
    return int(np.argmin(np.abs(capture.scans.times_s - share * times[0])))


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
