"""Echoes that have nothing to do with the plate: seen again by way of the probe, or standing still.

Where the stand-off varies, these move with the front as no echo of the plate does: the front's
second arrival falls behind it by as much again, and what stands still in the record comes nearer
by as much. They are followed in lines that are moved so that they stay at one place.
"""

from dataclasses import replace

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.recorded.band import Band, Complexes
from rona_core.ultrasound.recorded.echo_tracks import Peaks, Track, follow, neighbours, predicted

MOVES_US = 0.05  # of the front; less tells nothing about what moves with it
FAR_US = 0.5  # by which a plain tilt must move the front
TURNED = 0.12  # how near a slope is to that of an echo that has nothing to do with the plate
LEFT = 0.4  # of an echo's own scatter, when its movement with the front is taken away
LEFT_FAR = 0.15  # the same with the tilt, which a wedge has too
AT_FRONT_US = 0.25  # how near a multiple between front and probe is to its time
PULSE_DELAY = 1.5  # from the emission to the middle of the pulse, over its length
ONSET = 0.04  # of the peak, at which a pulse begins
ROUNDS = 12
LEAST_US = 1e-4
SLIP = 0.2  # cycles about whole ones: fronts taken a cycle off, not moved
SLIPPED = 0.9
NEAR = 0.3  # of the pulse length: the same peak
FOLLOWED = 3
STEADY = 0.6  # share of scans that agree with their neighbours
MOST_SCANS = 0.45  # of them, so that a few fronts at a wrong cycle are no movement


def pulse_delay_us(lines: Complexes, zero: int, ok: Bools, sampling_mhz: float) -> float:
    """Return how far the mean front of lines (n, samples) begins before its point of time."""
    if not ok.any():
        return 0.0
    envelope = np.abs(lines[ok].mean(axis=0))[: zero + 1]
    faint = envelope < ONSET * envelope[-1]
    return float(np.argmax(faint[::-1]) if faint.any() else zero) / sampling_mhz


def comes_again(
    track: Track, front_us: Floats, ok: Bools, band: Band, delay_us: float = 0.0
) -> bool:
    """Return whether an echo is as late after the front as this is after the emission.

    Or a small number of times as late.

    Args:
        track: The echo.
        front_us: Time (n,) of the front after the emission.
        ok: Scans (n,) with a front.
        band: Of the echoes.
        delay_us: From the begin of a pulse to the point at which it is timed.
    """
    both = track.there & ok
    if not both.any():
        return False
    # what was timed of the front is later than its begin, by less than a pulse
    late = AT_FRONT_US + max(PULSE_DELAY * band.length_us, delay_us + 0.5 * band.length_us)
    return any(
        -AT_FRONT_US < float(np.median(front_us[both] - track.lag_us[both] / times)) < late
        for times in range(1, 7)
    )


def is_foreign(
    track: Track,
    front_us: Floats,
    ok: Bools,
    start_known: bool,
    band: Band,
    positions_mm: Floats | None,
    delay_us: float = 0.0,
    cut: bool = False,
) -> bool:
    """Return whether an echo stands still, or comes by way of the probe.

    Where the fronts were ``cut`` off, they may be timed wrongly by a cycle, and what seems to
    stand still is everything else.
    """
    both = track.there & ok
    again = start_known and comes_again(track, front_us, ok, band, delay_us)
    if both.sum() < 8:
        return again
    # a wedge behind a tilted plate goes with the front too: only what is not a plane tells
    order = np.arange(len(front_us), dtype=np.float64)[:, None]
    place = order if positions_mm is None else positions_mm
    lag, front = bent(track.lag_us[both], place[both]), bent(front_us[both], place[both])
    if _slips(front, band):
        whole = np.abs(front) < 0.5 / band.centre_mhz
        lag, front = lag[whole], front[whole]
    if len(front) < 8 or spread(front) < MOVES_US:
        return again or _tilts_alike(track.lag_us[both], front_us[both], start_known)
    slope = _slope(front, lag)
    ways = (1.0, 2.0) if cut and spread(front) < 1.0 / band.centre_mhz else (-1.0, 1.0, 2.0)
    for wrong in ways:
        left = lag - wrong * front
        sure = 2.0 if wrong > 0 and again else 1.0  # both its time and its movement fit
        if abs(slope - wrong) < sure * TURNED and spread(left) < LEFT * spread(lag):
            return again if wrong > 0 and start_known else True
    return False  # what comes by way of the probe would move


def without_foreign(
    peaks: Peaks,
    front_us: Floats,
    ok: Bools,
    start_known: bool,
    band: Band,
    tree: tuple[Ints, Ints],
    positions_mm: Floats | None,
    delay_us: float,
    cut: bool,
) -> tuple[Peaks, list[Track]]:
    """Return the peaks that are not of such echoes, and these echoes.

    Arguments as for ``is_foreign``; ``tree`` joins neighbours.
    """
    if ok.sum() < 8:
        return peaks, []
    order = np.arange(len(front_us), dtype=np.float64)[:, None]
    place = order if positions_mm is None else positions_mm
    uneven = spread(bent(front_us[ok], place[ok]))
    if uneven < MOVES_US and spread(front_us[ok]) < FAR_US:
        return peaks, []
    moved = np.where(ok, front_us - np.median(front_us[ok]), 0.0)
    near = neighbours(len(ok), positions_mm)
    found: list[Track] = []
    for way in (1.0, 2.0, -1.0):
        still = replace(peaks, lag_us=peaks.lag_us - way * moved[:, None])
        for track in follow(still, tree, band, ok, most=FOLLOWED):
            back = replace(track, lag_us=track.lag_us + way * moved)
            many = track.there.sum() > MOST_SCANS * ok.sum()
            # evenly spaced multiples offer a peak near any place, but not always the same
            around = predicted(track.lag_us, track.there, near, positions_mm)
            off = np.abs(track.lag_us - around)[track.there & np.isfinite(around)]
            many = many and float((off < NEAR * band.length_us).mean()) > STEADY
            if many and is_foreign(
                back, front_us, ok, start_known, band, positions_mm, delay_us, cut
            ):
                found.append(back)
                gone = np.abs(peaks.lag_us - back.lag_us[:, None]) < NEAR * band.length_us
                gone &= track.there[:, None]
                peaks = replace(peaks, level=np.where(gone, 0.0, peaks.level))
    return peaks, found


def _tilts_alike(lag: Floats, front: Floats, start_known: bool) -> bool:
    """Return whether an echo stands still where the front moves far, if but along a plane."""
    if start_known or spread(front) < FAR_US:
        return False
    return any(spread(lag - way * front) < LEFT_FAR * spread(lag) for way in (-1.0, 1.0))


def _slips(front: Floats, band: Band) -> bool:
    """Return whether fronts (n,) are off by whole cycles, which no stand-off is."""
    cycles = front * band.centre_mhz
    whole = np.abs(cycles - np.rint(cycles)) < SLIP
    return float(whole.mean()) > SLIPPED and bool((np.abs(cycles) > 0.5).any())


def bent(values: Floats, place: Floats) -> Floats:
    """Return what is left of values (n,) about a plane of least absolute deviation over places."""
    centred = place - place.mean(axis=0)
    design = np.column_stack((np.ones(len(values)), centred / max(np.abs(centred).max(), 1e-9)))
    left, root = values - np.median(values), np.ones(len(values))
    for _ in range(ROUNDS):
        left = values - design @ np.linalg.lstsq(design * root[:, None], values * root)[0]
        root = 1.0 / np.sqrt(np.maximum(np.abs(left), LEAST_US))
    return left


def spread(values: Floats) -> float:
    """Return the robust standard deviation of values (n,)."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _slope(x: Floats, y: Floats) -> float:
    """Return the slope of y over x, by least squares that outliers are taken from."""
    kept = np.ones(len(x), dtype=np.bool_)
    slope = 0.0
    for _ in range(4):
        dx, dy = x[kept] - x[kept].mean(), y[kept] - y[kept].mean()
        slope = float((dx * dy).sum() / max(float((dx**2).sum()), 1e-12))
        left = y - slope * x
        left = left - np.median(left[kept])
        kept = np.abs(left) <= max(3.0 * spread(left), 1e-6)
    return slope
