"""Which of the echoes behind the front is the back wall of the first plate.

Behind a plate lie its own multiples, a floor or a second plate, and the front seen again by way
of the probe; in front of its back wall lie the last lobes of the pulse and, in bone, layers.
"""

import numpy as np

from rona_core.arrays import Bools, Floats, Ints
from rona_core.ultrasound.echo_tracks import Track, predicted
from rona_core.ultrasound.recorded_signal import Band

LEAST_SHARE = 0.2  # of the loudest echo of the plate and what is behind it
MOVES_US = 0.12  # of the front; less tells nothing about what moves with it
TURNED = 0.12  # how near a slope is to that of an echo that has nothing to do with the plate
AT_FRONT_US = 0.25  # how near a multiple between front and probe is to its time
LOBE_REACH = 4.5  # of the pulse, over its length
NEAR_REACH = 2.6
LOBE_LEVEL = 0.22  # over the front; lobes of real pulses are below, later ones more so
LATE_LOBE_LEVEL = 0.13
FEW = 12  # scans, among which neighbours may be far apart
LOUD_SHARE = 0.5
STEADY = 0.6  # share of scans that agree with their neighbours
AGREES = 0.25  # of the pulse length
WANDERS = 0.2  # cycles that a lobe may seem to move
TWICE = 0.35  # of the pulse length: how well a multiple fits


def choose_back_wall(
    tracks: list[Track],
    front_us: Floats,
    ok: Bools,
    start_known: bool,
    band: Band,
    near: Ints,
    positions_mm: Floats | None,
) -> int | None:
    """Return which track is the back wall: the first that is loud enough and explained by nothing.

    Args:
        tracks: Echoes behind the front.
        front_us: Time (n,) of the front after the emission, or of the record where not known.
        ok: Scans (n,) with a front.
        start_known: Whether the time of the emission is known.
        band: Of the echoes.
        near: Neighbours (n, k) of each scan.
        positions_mm: Of the scans (n, 1 to 3), where they are known.
    """
    own = [k for k, t in enumerate(tracks) if not _is_foreign(t, front_us, ok, start_known, tracks)]
    if not own:
        return None
    judged = [steadiness(t, near, positions_mm, band) for t in tracks]
    full = max(float(tracks[k].there.sum()) for k in own)
    own = [k for k in own if tracks[k].there.sum() >= 0.5 * full]
    loudest = max(tracks[k].typical_level for k in own)
    # what is nearly as loud as anything is an echo, however it jumps from scan to scan
    own = [
        k
        for k in own
        if judged[k][0] >= STEADY
        or len(front_us) < FEW
        or tracks[k].typical_level >= LOUD_SHARE * loudest
    ]
    loudest = max(tracks[k].typical_level for k in own)
    loud = [k for k in own if tracks[k].typical_level >= LEAST_SHARE * loudest]
    loud.sort(key=lambda k: tracks[k].typical_us)
    for k in loud:
        if not _is_lobe(tracks[k], judged[k][1], [tracks[j] for j in own if j != k], band):
            return k
    return loud[0]


def _is_foreign(
    track: Track, front_us: Floats, ok: Bools, start_known: bool, tracks: list[Track]
) -> bool:
    """Return whether an echo stands still, or comes by way of the probe."""
    both = track.there & ok
    lag, front = track.lag_us[both], front_us[both]
    if both.sum() >= 8 and _spread(front) > MOVES_US:
        slope = _slope(front, lag)
        for wrong in (-1.0, 1.0):
            left = lag - wrong * front
            if abs(slope - wrong) < TURNED and _spread(left) < 0.4 * _spread(lag):
                return True
        return False  # what comes by way of the probe would move
    if start_known and len(tracks) > 1 and both.any():
        away = float(np.median(np.abs(lag - front)))
        return away < AT_FRONT_US
    return False


def _is_lobe(track: Track, wanders: bool, others: list[Track], band: Band) -> bool:
    """Return whether an early weak echo is rather the end of the front's own pulse."""
    if wanders or not is_early_and_weak(track, band):
        return False
    later = [
        t
        for t in others
        if t.typical_level > 0.5 * track.typical_level and t.typical_us > track.typical_us
    ]
    # a lobe comes behind every echo, and so behind one at twice its own lag
    lobes = [u.typical_us + track.typical_us for u in later]
    multiples = [
        t
        for t in others
        if 0.2 * track.typical_level < t.typical_level < 0.9 * track.typical_level
        and all(abs(t.typical_us - lobe) > TWICE * band.length_us for lobe in lobes)
        and any(abs(t.typical_us - k * track.typical_us) < TWICE * band.length_us for k in (2, 3))
    ]
    return bool(later) and not multiples


def is_early_and_weak(track: Track, band: Band) -> bool:
    """Return whether an echo could be a lobe of the front's own pulse."""
    length = band.length_us
    level = LOBE_LEVEL if track.typical_us < NEAR_REACH * length else LATE_LOBE_LEVEL
    return track.typical_us < LOBE_REACH * length and track.typical_level < level


def steadiness(
    track: Track, near: Ints, positions_mm: Floats | None, band: Band
) -> tuple[float, bool]:
    """Return the share of scans that agree with their neighbours, and whether the echo wanders.

    It does if it changes its distance from the front, as no lobe does, and smoothly, as noise
    does not.
    """
    if near.shape[1] < 3:
        return 1.0, False
    around = predicted(track.lag_us, track.there, near, positions_mm)
    known = track.there & np.isfinite(around)
    if not known.any():
        return 0.0, False
    off = (track.lag_us - around)[known]
    spread = _spread(track.lag_us[known])
    wanders = spread > WANDERS / band.centre_mhz and _spread(off) < 0.5 * spread
    return float((np.abs(off) < AGREES * band.length_us).mean()), wanders


def _spread(values: Floats) -> float:
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
        kept = np.abs(left) <= max(3.0 * _spread(left), 1e-6)
    return slope
