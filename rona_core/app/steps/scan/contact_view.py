"""What a scan says of its contact and of its clocks: figures, and sentences for people."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.app.steps.scan.inputs import DELAY
from rona_core.devices.wrench import (
    CONTACT,
    LOST,
    STATES,
    STOPPED,
    ForceNow,
    ForceSummary,
    summarize,
)
from rona_core.geometry.arrays import Floats
from rona_core.robot.force_control.gravity_compensation import mass_disagreement
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session

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
    rms = "" if found.rms_n is None else f"±{found.rms_n:.2f} N (RMS) about it, "
    words = (
        f"Set point {found.setpoint_n:.1f} N: {rms}largest force {found.peak_n:.1f} N. "
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
