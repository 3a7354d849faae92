"""The force of a scan as it is drawn: over the path or over time, and the newest seconds live."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.devices.wrench import CONTACT, LOST, STATES, STOPPED, ForceNow
from rona_core.geometry.arrays import Floats
from rona_core.session.document import Session

Across = Literal["path", "time"]


@dataclass(frozen=True, slots=True, eq=False)
class ForceCurve:
    """A force curve (n,) with what it is to keep to."""

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
