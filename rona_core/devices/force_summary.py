"""A contact scan in a few figures: force about its set point, travel, speed, and how it ended."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.force import LOST, STOPPED, ForceTrack


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
