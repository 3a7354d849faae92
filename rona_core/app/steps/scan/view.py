"""What a scan says of its contact and clocks, and of the head, in figures and in words."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.references import HeadWatch, watch_head
from rona_core.app.steps.scan.derivation import DELAY, POSES
from rona_core.devices.wrench import (
    CONTACT,
    LOST,
    STATES,
    STOPPED,
    ForceNow,
    ForceSummary,
    summarize,
)
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.robot.force_control.gravity_compensation import mass_disagreement
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session

FORCE_RMS, FORCE_PEAK = FIGURES["contact_force_rms_n"], FIGURES["contact_force_peak_n"]
SHIFT, SHIFT_SIGMA = FIGURES["head_shift_mm"], FIGURES["head_shift_sigma_mm"]
MOTION = FIGURES["head_motion_mm"]

SLOWED = 0.97  # of the certified speed: less is worth a word


@dataclass(frozen=True, slots=True)
class DelayShare:
    """How late the joint angles arrive, and what of it is left in the map along the path."""

    delay_ms: float
    sigma_ms: float
    speed_mm_per_s: float
    uncorrected_mm: float  # by which the map would be shifted
    left_mm: float  # standard deviation that the correction leaves


@dataclass(frozen=True, slots=True)
class ContactReport:
    """One scan: how it was pressed on, and how well poses and echoes share one clock."""

    contact: ForceSummary | None  # None: driven by position alone, or never pressed on
    delay: DelayShare | None  # None: the scan does not tell
    sentence: str
    mass: str | None = None  # that the weighed mass is not the stated one, and what to do


def contact_report(session: Session) -> ContactReport | None:
    """Return what the scan says; None before there is one."""
    capture = session.captures.scan
    if capture is None:
        return None
    found = None if capture.forces is None else summarize(capture.forces)
    if capture.forces is None:
        sentence = "Driven by position alone: the force was not measured."
    elif found is None:
        why = capture.forces.reason
        sentence = "The probe was never pressed on" + (f": {why}." if why else ".")
    else:
        sentence = contact_sentence(found)
    tool = robot_model(session.setup.devices.robot.model).tool
    mass = None if capture.forces is None else mass_disagreement(capture.forces.load, tool)
    return ContactReport(found, delay_share(session), sentence, mass)


def delay_share(session: Session) -> DelayShare | None:
    """Return the delay of the poses and its share in the error along the path."""
    delay = DELAY.read(session)
    if delay is None:
        return None
    speed = session.setup.devices.robot.scan_speed_mm_per_s
    return DelayShare(
        delay_ms=1e3 * delay.delay_s,
        sigma_ms=1e3 * delay.sigma_s,
        speed_mm_per_s=speed,
        uncorrected_mm=delay.way_mm(speed),
        left_mm=delay.sigma_mm(speed),
    )


def contact_sentence(found: ForceSummary) -> str:
    """Return a summary of the force as people read it."""
    rms = "" if found.rms_n is None else f"±{FORCE_RMS.words(found.rms_n)} (RMS) about it, "
    words = (
        f"Set point {found.setpoint_n:.1f} N: {rms}largest force "
        f"{FORCE_PEAK.words(found.peak_n)}. "
        f"Corrections of {found.travel_low_mm:+.1f} to {found.travel_high_mm:+.1f} mm along the "
        f"tool axis; stiffness {found.stiffness_n_per_mm:.1f} N/mm."
    )
    if found.mean_share < SLOWED:
        words += f" The contact slowed the scan to {100 * found.mean_share:.0f} % of its speed."
    if found.lost_s > 0.0:
        words += f" Contact was lost for {found.lost_s:.1f} s."
    if found.reason:
        words += f" Ended early: {found.reason}."
    return words


def delay_sentence(share: DelayShare) -> str:
    """Return the delay and its share in the error of the maps."""
    return (
        f"Joint angles arrive {share.delay_ms:.1f} ± {max(share.sigma_ms, 0.1):.1f} ms late. "
        f"At {share.speed_mm_per_s:.0f} mm/s that would shift the map by "
        f"{share.uncorrected_mm:.2f} mm along the path; "
        f"corrected, {max(share.left_mm, 0.001):.3f} mm are left."
    )


Across = Literal["path", "time"]


@dataclass(frozen=True, slots=True, eq=False)
class ForceCurve:
    """A force curve (n,) with its limits."""

    axis: str  # what ``at`` counts, with its unit
    at: Floats  # (n,) growing
    force_n: Floats  # (n,)
    states: tuple[str, ...]  # of the force loop, one for each
    setpoint_n: float
    monitor_n: float | None  # above it the probe yields; None where that is not known
    stop_n: float | None


def force_curve(session: Session, across: Across) -> ForceCurve | None:
    """Return the force of the last scan; None where there is none.

    Over the path only what was pressed on is there: before and after, the probe stays at its ends.
    """
    capture = session.captures.scan
    if capture is None or capture.forces is None or not len(capture.forces.times_s):
        return None
    track = capture.forces
    shown = np.ones(len(track.times_s), dtype=np.bool_)
    at, axis = track.times_s - track.times_s[0], "time (s)"
    if across == "path":
        shown = np.isin(track.states, (CONTACT, LOST, STOPPED)) & (track.way_mm > 0.0)
        at, axis = track.way_mm, "path (mm)"
        if np.count_nonzero(shown) < 2:
            return None
    monitor_n, stop_n = _limits(session, track.setpoint_n)
    return ForceCurve(
        axis=axis,
        at=np.maximum.accumulate(at[shown]),
        force_n=track.force_n[shown],
        states=tuple(STATES[code] for code in track.states[shown]),
        setpoint_n=track.setpoint_n,
        monitor_n=monitor_n,
        stop_n=stop_n,
    )


def live_force(session: Session, now: ForceNow) -> ForceCurve | None:
    """Return the newest seconds of a force loop that runs; time counts back from now."""
    if len(now.times_s) < 2:
        return None
    monitor_n, stop_n = _limits(session, now.setpoint_n)
    return ForceCurve(
        axis="time before now (s)",
        at=now.times_s - now.times_s[-1],
        force_n=now.force_n,
        states=tuple(STATES[code] for code in now.states),
        setpoint_n=now.setpoint_n,
        monitor_n=monitor_n,
        stop_n=stop_n,
    )


def _limits(session: Session, setpoint_n: float) -> tuple[float | None, float | None]:
    """Return the limits of the set-up, unless it is another one than that of the scan."""
    contact = session.setup.devices.robot.contact
    if contact is None or contact.force_n != setpoint_n:
        return None, None
    return contact.monitor_n, contact.stop_n


CAPTURES = {"surface": "step 4", "path": "step 5", "scan": "step 8", "second": "step 9"}
Axes = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class HeadShift:
    """How the head lay in one capture, against the first stroke of step 4."""

    capture: str
    state: Literal["still", "moved", "unchecked"]
    shift_mm: Axes | None = None  # mean along x, y, z of ``base``, at the middle of the scan
    sigma_mm: Axes | None = None  # of it
    turn_deg: float | None = None  # likewise
    range_mm: float | None = None  # farthest from its mean place meanwhile
    times_s: tuple[float, float] | None = None  # of the capture, in which it was watched
    reason: str = ""  # why it is unchecked


@dataclass(frozen=True, slots=True)
class HeadReport:
    """Pose of the head in every capture on it, by its marker."""

    shifts: tuple[HeadShift, ...]
    sentence: str  # about the scan


def head_report(session: Session) -> HeadReport | None:
    """Return the motion of the head by its marker; None before a scan that recorded it."""
    center = _middle(session)
    if center is None or watch_head(session, session.captures.scan) is None:
        return None
    shifts: list[HeadShift] = []
    for name in CAPTURES:
        held = session.captures.get(name)
        for capture in held if isinstance(held, tuple) else (held,):
            watch = watch_head(session, capture)
            if watch is not None:
                shifts.append(_shift(name, watch, center))
    scan = next(shift for shift in shifts if shift.capture == "scan")
    return HeadReport(tuple(shifts), head_sentence(scan))


def head_figures(session: Session) -> dict[str, float]:
    """Return shift, its sigma and the motion of the head in the scan, by ``docs/metrics.md``."""
    report = head_report(session)
    scan = None if report is None else next(s for s in report.shifts if s.capture == "scan")
    if scan is None or scan.shift_mm is None or scan.sigma_mm is None or scan.range_mm is None:
        return {}
    return {
        "head_shift_mm": float(np.linalg.norm(scan.shift_mm)),
        "head_shift_sigma_mm": float(np.linalg.norm(scan.sigma_mm)),
        "head_motion_mm": scan.range_mm,
    }


def head_sentence(scan: HeadShift) -> str:
    """Return what the head did up to the scan and in it, as people read it."""
    if scan.shift_mm is None or scan.sigma_mm is None or scan.range_mm is None:
        return f"It is not known whether the head moved: {scan.reason}. The maps are not corrected."
    sigma = SHIFT_SIGMA.words(float(np.linalg.norm(scan.sigma_mm)))
    if scan.state == "still":
        return f"The head has not moved since step 4 (± {sigma}, by its marker)."
    shift = SHIFT.words(float(np.linalg.norm(scan.shift_mm))).removesuffix(f" {SHIFT.unit}")
    x, y, z = (round(part, 3) + 0.0 for part in scan.shift_mm)  # no "-0.000"
    return (
        f"The head has moved by {shift} ± {sigma} since step 4 ({x:+.3f}, {y:+.3f}, {z:+.3f} "
        f"along x, y, z), and by up to {MOTION.words(scan.range_mm)} in the course of the scan: "
        "the maps are corrected for it, and show it as it lay in step 4."
    )


def unwatched(session: Session) -> str | None:
    """Return why the motion of the head in the scan is unknown; None where it is known or old."""
    watch = watch_head(session, session.captures.scan)
    return watch.reason if watch is not None and watch.state == "unchecked" else None


def _shift(name: str, watch: HeadWatch, center: Vector3) -> HeadShift:
    motion = watch.motion
    if motion is None:
        return HeadShift(name, watch.state, reason=watch.reason)
    return HeadShift(
        capture=name,
        state=watch.state,
        shift_mm=_axes(motion.shift_at(center)),
        sigma_mm=_axes(motion.sigma_at(center)),
        turn_deg=motion.turn_deg,
        range_mm=motion.range_at(center),
        times_s=(float(motion.times_s[0]), float(motion.times_s[-1])),
    )


def _axes(vector: Vector3) -> Axes:
    x, y, z = vector.tolist()
    return x, y, z


def _middle(session: Session) -> Vector3 | None:
    """Return the middle (3,) of the scanned places in ``base``."""
    poses = POSES.read(session)
    return poses.translations.mean(axis=0) if poses is not None and len(poses) else None
