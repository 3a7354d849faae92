"""Which of the echoes behind the front is the back wall of the first plate.

Behind a plate lie its own multiples, a floor or a second plate, and the front seen again by way
of the probe; in front of its back wall lie the last lobes of the pulse and, in bone, layers.
"""

from collections.abc import Callable

import numpy as np

from rona_core.arrays import Bools, Floats, Ints
from rona_core.ultrasound.echo_tracks import Track, predicted
from rona_core.ultrasound.recorded_signal import Band

LEAST_SHARE = 0.2  # of the loudest echo of the plate and what is behind it
MOVES_US = 0.05  # of the front; less tells nothing about what moves with it
TURNED = 0.12  # how near a slope is to that of an echo that has nothing to do with the plate
AT_FRONT_US = 0.25  # how near a multiple between front and probe is to its time
CONTACT_LEVEL = 0.2  # of the second round trip in a plate, over the first
PULSE_DELAY = 1.5  # from the emission to the middle of the pulse, over its length
LOBE_REACH = 4.5  # of the pulse, over its length
NEAR_REACH = 2.6
LOBE_LEVEL = 0.22  # over the front; lobes of real pulses are below, later ones more so
LATE_LOBE_LEVEL = 0.13
GHOST_REACH = 9.0  # echoes from within the probe come later, and are fainter still
CLOSE_REACH = 4.0
GHOST_LEVEL = 0.05
LONE_LEVEL = 1.0  # of the front's second arrival, over an echo that nothing else speaks for
FAINT = 0.1
DOUBLE = 1.4  # between once and twice
FEW = 12  # scans, among which neighbours may be far apart
LOUD_SHARE = 0.5
STEADY = 0.6  # share of scans that agree with their neighbours
AGREES = 0.25  # of the pulse length
WANDERS = 0.2  # cycles that a lobe may seem to move
TWICE = 0.25  # of the pulse length: how well a multiple fits


def choose_back_wall(
    tracks: list[Track],
    front_us: Floats,
    ok: Bools,
    start_known: bool,
    band: Band,
    near: Ints,
    positions_mm: Floats | None,
    damped: Callable[[Track], bool],
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
        damped: Whether an echo has lost high frequencies against the front.
    """
    foreign = [_is_foreign(t, front_us, ok, start_known, band, positions_mm) for t in tracks]
    others = [t for t, no in zip(tracks, foreign, strict=True) if no]
    own = [
        k
        for k, no in enumerate(foreign)
        if not no and not any(_is_lobe_of(tracks[k], t, band) for t in others)
    ]
    first = _contact(tracks, front_us, ok, start_known, band, damped)
    if first is not None:
        return first
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
        rest = [tracks[j] for j in own if j != k]
        lobe = _is_lobe(tracks[k], judged[k][1], rest, band)
        lobe = lobe or _is_alone(tracks[k], judged[k][1], tracks, others, band)
        if not lobe or _comes_twice(tracks[k], tracks, others, band):
            return k
    return None


def _is_foreign(
    track: Track,
    front_us: Floats,
    ok: Bools,
    start_known: bool,
    band: Band,
    positions_mm: Floats | None,
) -> bool:
    """Return whether an echo stands still, or comes by way of the probe."""
    both = track.there & ok
    again = start_known and _again(track, front_us, ok, band)
    if both.sum() < 8:
        return again
    lag, front = track.lag_us[both], front_us[both]
    # a wedge behind a tilted plate goes with the front too: only what is not a plane tells
    order = np.arange(len(front_us), dtype=np.float64)[:, None]
    place = order if positions_mm is None else positions_mm
    lag, front = _bent(lag, place[both]), _bent(front, place[both])
    if _spread(front) < MOVES_US:
        return again
    slope = _slope(front, lag)
    for wrong in (-1.0, 1.0):
        left = lag - wrong * front
        if abs(slope - wrong) < TURNED and _spread(left) < 0.4 * _spread(lag):
            return again if wrong > 0 and start_known else True
    return False  # what comes by way of the probe would move


def _bent(values: Floats, place: Floats) -> Floats:
    """Return what is left of values (n,) about a plane over places (n, k)."""
    centred = place - place.mean(axis=0)
    design = np.column_stack((np.ones(len(values)), centred / max(np.abs(centred).max(), 1e-9)))
    return values - design @ np.linalg.lstsq(design, values)[0]


def _contact(
    tracks: list[Track],
    front_us: Floats,
    ok: Bools,
    start_known: bool,
    band: Band,
    damped: Callable[[Track], bool],
) -> int | None:
    """Return the echo that is the second round trip in a plate under the probe itself.

    Then nothing lies between emission and back wall: what was taken for the front is the back
    wall, and whatever follows comes at multiples of its time. Behind water the second arrival
    from the front is fainter, and as sharp as the first.
    """
    if not start_known or not tracks:
        return None
    near = [k for k, t in enumerate(tracks) if _again(t, front_us, ok, band)]
    if not near:
        return None
    first = max(near, key=lambda k: tracks[k].typical_level)
    lag, level = tracks[first].typical_us, tracks[first].typical_level
    order = [
        t.typical_us / lag
        for t in tracks
        if t.typical_level > FAINT * level
        and not is_early_and_weak(t, band)
        and not any(_is_lobe_of(t, tracks[k], band) for k in near)
    ]
    even = all(abs(k - round(k)) * lag < TWICE * band.length_us * max(round(k), 1) for k in order)
    if not even:
        return None
    return first if level > CONTACT_LEVEL or damped(tracks[first]) else None


def _again(track: Track, front_us: Floats, ok: Bools, band: Band) -> bool:
    """Return whether an echo is as late after the front as this is after the emission."""
    both = track.there & ok
    if not both.any():
        return False
    # what was timed of the front is later than its begin, by less than a pulse
    late = AT_FRONT_US + PULSE_DELAY * band.length_us
    return any(
        -AT_FRONT_US < float(np.median(front_us[both] - track.lag_us[both] / times)) < late
        for times in range(1, 7)
    )


def _is_lobe(track: Track, wanders: bool, others: list[Track], band: Band) -> bool:
    """Return whether an early weak echo is rather the end of the front's own pulse."""
    if not is_early_and_weak(track, band):
        return False
    # close behind a front that was cut off and restored, what is faint wanders too
    close = track.typical_us < CLOSE_REACH * band.length_us and track.typical_level < GHOST_LEVEL
    least = 0.5 if not wanders else 2.0
    if wanders and not close:
        return False
    later = [
        t
        for t in others
        if t.typical_level > least * track.typical_level and t.typical_us > track.typical_us
    ]
    return bool(later) and not _has_multiples(track, later, others, band)


def _has_multiples(track: Track, later: list[Track], others: list[Track], band: Band) -> bool:
    """Return whether an echo comes again at twice or three times its lag."""
    # a lobe comes behind every echo, and so behind one at twice its own lag; and a louder echo
    # has multiples of its own
    lobes = [u.typical_us + track.typical_us for u in later]
    lobes += [2.0 * u.typical_us for u in later if u.typical_level > 2.0 * track.typical_level]
    return any(
        0.2 * track.typical_level < t.typical_level < 0.9 * track.typical_level
        and all(abs(t.typical_us - lobe) > TWICE * band.length_us for lobe in lobes)
        and any(abs(t.typical_us - k * track.typical_us) < TWICE * band.length_us for k in (2, 3))
        for t in others
    )


def _is_alone(
    track: Track, wanders: bool, tracks: list[Track], foreign: list[Track], band: Band
) -> bool:
    """Return whether an early weak echo is the only one that is not explained, and a lobe.

    Only the front's second arrival by way of the probe is louder, and there is no multiple.
    """
    louder = [t for t in foreign if t.typical_level > LONE_LEVEL * track.typical_level]
    if wanders or not is_early_and_weak(track, band) or not louder:
        return False
    rest = [t for t in tracks if t is not track]
    return not _has_multiples(track, [], rest, band)


def _comes_twice(track: Track, tracks: list[Track], foreign: list[Track], band: Band) -> bool:
    """Return whether an echo is twice as strong behind the second arrival of the front.

    A lobe has the same level behind both; a back wall twice that, for it is passed on the first
    or on the second way.
    """
    for second in foreign:
        for t in tracks:
            if abs(t.typical_us - second.typical_us - track.typical_us) < TWICE * band.length_us:
                again = t.typical_level / second.typical_level
                if DOUBLE * track.typical_level < again < 3.0 * track.typical_level:
                    return True
    return False


def _is_lobe_of(track: Track, main: Track, band: Band) -> bool:
    """Return whether an echo could be a lobe of another one that is before it."""
    after = track.typical_us - main.typical_us
    return after > 0 and _early_and_weak(after, track.typical_level / main.typical_level, band)


def is_early_and_weak(track: Track, band: Band) -> bool:
    """Return whether an echo could be a lobe of the front's own pulse."""
    return _early_and_weak(track.typical_us, track.typical_level, band)


def _early_and_weak(after_us: float, level: float, band: Band) -> bool:
    reaches = ((NEAR_REACH, LOBE_LEVEL), (LOBE_REACH, LATE_LOBE_LEVEL), (GHOST_REACH, GHOST_LEVEL))
    return any(after_us < reach * band.length_us and level < most for reach, most in reaches)


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
