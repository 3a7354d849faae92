"""Wrench samples of a six-axis force sensor, and tracks of them by column.

A wrench (6,) is force x, y, z in N and torque x, y, z in N mm about the origin of ``sensor``, as
the tool and what touches it act on the sensor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Floats, Ints, readonly

FREE, APPROACH, CONTACT, LOST, RETRACT, STOPPED = range(6)
STATES = ("free", "approach", "contact", "lost", "retract", "stopped")  # by code
SHOWN_ROWS = 625  # of the control loop that are shown live: ten seconds


@dataclass(frozen=True, slots=True)
class SensorModel:
    """Ranges and resolution of a force sensor."""

    name: str = "JR3"
    force_range_n: float = 63.0
    torque_range_nmm: float = 5000.0
    steps: int = 4000  # of each range
    cutoff_hz: float = 30.0  # of its low-pass filter

    @property
    def ranges(self) -> Floats:
        """Largest value (6,) of each axis."""
        return np.repeat((self.force_range_n, self.torque_range_nmm), 3)


JR3 = SensorModel()


@dataclass(frozen=True, slots=True, eq=False)
class WrenchSample:
    """One reading of the sensor."""

    time_s: float
    wrench: Floats  # (6,)
    saturated: bool = False


class ForceSensor(Protocol):
    """A six-axis force sensor between flange and tool."""

    @property
    def model(self) -> SensorModel:
        """Ranges and resolution."""
        ...

    def read(self) -> WrenchSample:
        """Return what the sensor shows now."""
        ...

    def close(self) -> None:
        """Release the device; a second call does nothing."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ToolLoad:
    """Weight of what hangs on the sensor, and what the sensor shows without any."""

    mass_kg: float
    com_sensor_mm: Floats  # (3,) centre of mass
    offset: Floats  # (6,) wrench that is shown without load
    residual_n: float  # RMS of the forces that the fit leaves over, per axis
    residual_nmm: float  # the same of the torques
    n_poses: int
    # standard deviation of the mass by the residual; 0 in files of earlier versions
    mass_sigma_kg: float = field(default=0.0, metadata={"omit_empty": True})


@dataclass(frozen=True, slots=True, eq=False)
class ForceTrack:
    """The control loop over a scan, one row for each step (n,)."""

    times_s: Floats  # (n,)
    force_n: Floats  # (n,) pressing force along the tool axis, weight taken off
    wrench: NDArray[np.float32]  # (n, 6) as read
    states: Ints  # (n,) index into STATES
    travel_mm: Floats  # (n,) correction along the tool axis, as the robot reports it
    feed_share: Floats  # (n,) of the certified speed
    way_mm: Floats  # (n,) along the scan path
    setpoint_n: float
    stiffness_n_per_mm: float  # estimated, when the scan ended
    band_mm: float  # the certified motion holds for corrections up to this, either way
    load: ToolLoad
    reason: str = ""  # why it ended early, empty if it did not

    @property
    def in_contact(self) -> NDArray[np.bool_]:
        """Return which steps (n,) are part of the scan: pressed on, or fallen out of contact."""
        return (self.states == CONTACT) | (self.states == LOST)


@dataclass(frozen=True, slots=True, eq=False)
class ForceNow:
    """The newest steps of a control loop that runs (n,), oldest first."""

    times_s: Floats
    force_n: Floats
    states: Ints
    setpoint_n: float


@dataclass(frozen=True, slots=True, eq=False)
class LoopRow:
    """One step of the control loop."""

    sample: WrenchSample
    force_n: float
    state: int
    travel_mm: float
    feed_share: float
    way_mm: float


def force_now(
    rows: Sequence[LoopRow], setpoint_n: float, before: ForceNow | None = None
) -> ForceNow:
    """Return the newest rows of a control loop by column, at most ``SHOWN_ROWS``.

    Args:
        rows: Those that have come since ``before``.
        setpoint_n: Force that is aimed at.
        before: What was shown last; None: nothing.
    """
    times_s = np.array([row.sample.time_s for row in rows], dtype=np.float64)
    force_n = np.array([row.force_n for row in rows], dtype=np.float64)
    states = np.array([row.state for row in rows], dtype=np.int64)
    if before is not None:
        times_s = np.concatenate((before.times_s, times_s))
        force_n = np.concatenate((before.force_n, force_n))
        states = np.concatenate((before.states, states))
    newest = slice(-SHOWN_ROWS, None)
    return ForceNow(
        readonly(times_s[newest]), readonly(force_n[newest]), readonly(states[newest]), setpoint_n
    )


def force_track(
    rows: Sequence[LoopRow],
    *,
    setpoint_n: float,
    stiffness_n_per_mm: float,
    band_mm: float,
    load: ToolLoad,
    reason: str = "",
) -> ForceTrack:
    """Return the rows of a control loop by column."""
    wrenches = np.array([row.sample.wrench for row in rows], dtype=np.float32).reshape(-1, 6)

    def column(values: list[float]) -> Floats:
        return readonly(np.array(values, dtype=np.float64))

    return ForceTrack(
        times_s=column([row.sample.time_s for row in rows]),
        force_n=column([row.force_n for row in rows]),
        wrench=readonly(wrenches),
        states=readonly(np.array([row.state for row in rows], dtype=np.int64)),
        travel_mm=column([row.travel_mm for row in rows]),
        feed_share=column([row.feed_share for row in rows]),
        way_mm=column([row.way_mm for row in rows]),
        setpoint_n=setpoint_n,
        stiffness_n_per_mm=stiffness_n_per_mm,
        band_mm=band_mm,
        load=load,
        reason=reason,
    )


@dataclass(frozen=True, slots=True)
class ForceSummary:
    """What the force loop did while the probe went along the path."""

    rms_n: float | None  # of the force about its set point; None: it never went along the path
    peak_n: float  # largest force, pressing on and lifting off included
    setpoint_n: float
    stiffness_n_per_mm: float  # of probe and bone together, as estimated
    travel_low_mm: float  # correction along the tool axis on the path, least and most
    travel_high_mm: float
    mean_share: float  # of the certified speed, over the time on the path
    lost_s: float  # out of contact
    stopped: bool
    reason: str  # why it ended early, empty if it did not


def summarize(track: ForceTrack) -> ForceSummary | None:
    """Return the figures of a scan; None where the probe was never pressed on."""
    if not track.in_contact.any():
        return None
    scanning = track.in_contact & (track.way_mm > 0.0)
    some = scanning if scanning.any() else track.in_contact
    error_n = track.force_n[scanning] - track.setpoint_n
    spans_s = np.diff(track.times_s, append=track.times_s[-1])
    return ForceSummary(
        rms_n=float(np.sqrt((error_n**2).mean())) if scanning.any() else None,
        peak_n=float(track.force_n.max()),
        setpoint_n=track.setpoint_n,
        stiffness_n_per_mm=track.stiffness_n_per_mm,
        travel_low_mm=float(track.travel_mm[some].min()),
        travel_high_mm=float(track.travel_mm[some].max()),
        mean_share=float(track.feed_share[some].mean()),
        lost_s=float(spans_s[track.states == LOST].sum()),
        stopped=bool((track.states == STOPPED).any()),
        reason=track.reason,
    )
