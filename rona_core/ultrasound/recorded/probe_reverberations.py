"""Probe reverberations: echoes by way of the probe, or standing still.

Where the stand-off varies, these move with the front as no echo of the plate does: the front's
second arrival falls behind it by as much again, and what stands still in the record comes nearer
by as much.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.robust import mad_sigma, reweighted_least_squares
from rona_core.ultrasound.recorded.band import Band
from rona_core.ultrasound.recorded.echo_tracks import Track

MOVES_US = 0.05  # of the front; less does not show what moves with it
TURNED = 0.12  # how near a slope is to that of an echo that has nothing to do with the plate
LEFT = 0.4  # of an echo's own scatter, when its movement with the front is taken away
AT_FRONT_US = 0.25  # how near a multiple between front and probe is to its time
PULSE_DELAY = 1.5  # from the emission to the middle of the pulse, over its length
ROUNDS = 12
LEAST_US = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class FrontArrivals:
    """When the fronts (n,) came, by which an echo of the probe is known."""

    time_us: Floats  # (n,) after the emission, or after the first sample where that is not known
    ok: Bools  # (n,) scans with a front
    emission_known: bool
    band: Band
    positions_mm: Floats | None  # (n, 1 to 3), where they are known
    pulse_delay_us: float = 0.0  # from the begin of a pulse to the point at which it is timed
    cut: bool = False  # cut off: timed wrongly by a cycle perhaps

    @property
    def places(self) -> Floats:
        """Return the positions (n, 1 to 3), or the order of the file where they are not known."""
        order = np.arange(len(self.time_us), dtype=np.float64)[:, None]
        return order if self.positions_mm is None else self.positions_mm


def repeats_standoff(track: Track, fronts: FrontArrivals) -> bool:
    """Return whether an echo is as late after the front as this is after the emission.

    Or a small number of times as late: a multiple between probe and front.
    """
    both = track.present & fronts.ok
    if not both.any():
        return False
    # what was timed of the front is later than its begin, by less than a pulse
    length_us = fronts.band.length_us
    late = AT_FRONT_US + max(PULSE_DELAY * length_us, fronts.pulse_delay_us + 0.5 * length_us)
    return any(
        -AT_FRONT_US < float(np.median(fronts.time_us[both] - track.lag_us[both] / times)) < late
        for times in range(1, 7)
    )


def is_reverberation(track: Track, fronts: FrontArrivals) -> bool:
    """Return whether an echo stands still in the record, or is a multiple by way of the probe.

    Where the fronts were ``cut`` off, they may be timed wrongly by a cycle, and what seems to
    stand still is everything else.
    """
    band, known = fronts.band, fronts.emission_known
    both = track.present & fronts.ok
    again = known and repeats_standoff(track, fronts)
    if both.sum() < 8:
        return again
    # a wedge behind a tilted plate goes with the front too: only what is not a plane counts
    place, time_us = fronts.places, fronts.time_us
    lag = plane_residuals(track.lag_us[both], place[both])
    front = plane_residuals(time_us[both], place[both])
    if robust_sd(front) < MOVES_US:
        return again
    slope = _slope(front, lag)
    cycle_off = fronts.cut and robust_sd(front) < 1.0 / band.centre_mhz
    for expected in (1.0, 2.0) if cycle_off else (-1.0, 1.0, 2.0):
        rest = lag - expected * front
        reach = 2.0 if expected > 0 and again else 1.0  # both its time and its movement fit
        if abs(slope - expected) < reach * TURNED and robust_sd(rest) < LEFT * robust_sd(lag):
            return again if expected > 0 and known else True
    return False  # what comes by way of the probe would move


def plane_residuals(values: Floats, place: Floats) -> Floats:
    """Return the residuals (n,) of a plane of least absolute deviation over places."""
    centred = place - place.mean(axis=0)
    design = np.column_stack((np.ones(len(values)), centred / max(np.abs(centred).max(), 1e-9)))
    plane = reweighted_least_squares(
        design, values, lambda off: 1.0 / np.maximum(np.abs(off), LEAST_US), rounds=ROUNDS
    )
    return np.asarray(values - design @ plane)


def robust_sd(values: Floats) -> float:
    """Return the robust standard deviation of values (n,)."""
    return mad_sigma(values, center=float(np.median(values)))


def _slope(x: Floats, y: Floats) -> float:
    """Return the slope of y over x, by least squares that outliers are taken from."""
    kept = np.ones(len(x), dtype=np.bool_)
    slope = 0.0
    for _ in range(4):
        dx, dy = x[kept] - x[kept].mean(), y[kept] - y[kept].mean()
        slope = float((dx * dy).sum() / max(float((dx**2).sum()), 1e-12))
        residuals = y - slope * x
        residuals = residuals - np.median(residuals[kept])
        kept = np.abs(residuals) <= max(3.0 * robust_sd(residuals), 1e-6)
    return slope
