"""Which of the echoes behind the front is the back wall of the first plate.

Behind a plate lie its own multiples, a floor or a second plate, and the front seen again by way
of the probe; in front of its back wall lie the last lobes of the pulse and, in bone, layers.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.ultrasound.recorded.band import Band
from rona_core.ultrasound.recorded.echo_tracks import Track, largest_piece, predicted
from rona_core.ultrasound.recorded.probe_reverberations import robust_sd

LEAST_SHARE = 0.2  # of the loudest echo of the plate and what is behind it
LEAST_DAMPING = 0.35  # Np at mid-band, by a loss in proportion to frequency; water has less
CONTACT_LEVEL = 0.2  # of the second round trip in a plate, over the first
LOBE_REACH = 4.5  # of the pulse, over its length
NEAR_REACH = 2.6
LOBE_LEVEL = 0.22  # over the front; lobes of real pulses are below, later ones more so
LATE_LOBE_LEVEL = 0.13
GHOST_REACH = 9.0  # echoes from within the probe come later, and are fainter still
CLOSE_REACH = 4.0
GHOST_LEVEL = 0.05
GHOST_MOST = 0.1  # where a louder echo follows, and no loss explains why this is faint
LOUDER = 1.5
SMEARED = 2.0, 0.02  # within so many pulse lengths nothing so faint over the front is an echo
CUT_SHORT = 2.5
LOST = 0.25  # of a faint echo's loss, that must show in its spectrum
MIRROR = 30.0  # R / (1 - R^2) of steel in water is 8, and the field spreads
SHARPER = 0.5  # Np that a multiple may seem to have lost less than what it repeats
LONE_LEVEL = 1.0  # of the front's second arrival, over an echo that nothing else speaks for
FAINT = 0.05
DOUBLE = 1.4  # between once and twice
FEW = 12  # scans, among which neighbours may be far apart
LOUD_SHARE = 0.5
PATCHED = 0.5  # share of a whole echo's scans that are in one piece
STEADY = 0.6  # share of scans that agree with their neighbours
AGREES = 0.25  # of the pulse length
WANDERS = 0.2  # cycles that a lobe may seem to move
TWICE = 0.25  # of the pulse length: how well a multiple fits


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is known of the echoes behind a front beside their tracks."""

    timed: bool  # the time of the emission is known
    again: Callable[[Track], bool]  # as late after the front as this is after the emission
    loss_np: Callable[[Track], float]  # at mid-band, that an echo's spectrum shows
    cut: bool  # the fronts were cut off, so that levels over them are uncertain


def choose_back_wall(
    tracks: list[Track],
    foreign: list[bool],
    known: Evidence,
    band: Band,
    near: Ints,
    positions_mm: Floats | None,
) -> int | None:
    """Return which track is the back wall: the first that is loud enough and explained by nothing.

    Args:
        tracks: Echoes behind the front.
        foreign: Which of them have nothing to do with the plate.
        known: What else is known.
        band: Of the echoes.
        near: Neighbours (n, k) of each scan.
        positions_mm: Of the scans (n, 1 to 3), where they are known.
    """
    others = [t for t, no in zip(tracks, foreign, strict=True) if no]
    own: list[int] = [
        k
        for k, no in enumerate(foreign)
        if not no and not any(_is_lobe_of(tracks[k], t, band) for t in others)
    ]
    first = _contact(tracks, known, band)
    if first is not None:
        return first
    if not own:
        return None
    judged = [steadiness(t, near, positions_mm, band) for t in tracks]
    full = max(float(tracks[k].present.sum()) for k in own)
    own = [k for k in own if tracks[k].present.sum() >= 0.5 * full]
    loudest = max(tracks[k].typical_level for k in own)
    # what is nearly as loud as anything is an echo, however it jumps from scan to scan
    own = [
        k
        for k in own
        if judged[k][0] >= STEADY
        or len(near) < FEW
        or tracks[k].typical_level >= LOUD_SHARE * loudest
    ]
    own = _without_patchwork(tracks, own, near, band)
    while own:
        loudest = max(tracks[k].typical_level for k in own)
        loud = [k for k in own if tracks[k].typical_level >= LEAST_SHARE * loudest]
        loud.sort(key=lambda k: tracks[k].typical_us)
        for k in loud:
            rest = [tracks[j] for j in own if j != k]
            lobe = _is_lobe(tracks[k], judged[k][1], rest, band, known)
            lobe = lobe or _is_alone(tracks[k], judged[k][1], tracks, others, band, known)
            if not lobe or _comes_twice(tracks[k], tracks, others, band):
                return k
        # all of them belong to the pulse: the plate is among what is fainter
        own = [k for k in own if k not in loud]
    return None


def _without_patchwork(tracks: list[Track], own: list[int], near: Ints, band: Band) -> list[int]:
    """Return the echoes that are in one piece, or than which no such one is louder.

    A track pieced together from holes that lie one beside the other is no back wall.
    """
    if len(near) < FEW:
        return own
    step_us = band.length_us
    share = {
        k: largest_piece(tracks[k], near, step_us).sum() / tracks[k].present.sum() for k in own
    }
    even = max((tracks[k].typical_level for k in own if share[k] >= PATCHED), default=0.0)
    return [k for k in own if share[k] >= PATCHED or tracks[k].typical_level > even]


def _contact(tracks: list[Track], known: Evidence, band: Band) -> int | None:
    """Return the echo that is the second round trip in a plate under the probe itself.

    Then nothing lies between emission and back wall: what was taken for the front is the back
    wall, and whatever follows comes at multiples of its time. Behind water the second arrival
    from the front is fainter, and as sharp as the first.
    """
    if not known.timed or not tracks:
        return None
    near = [k for k, t in enumerate(tracks) if known.again(t)]
    if not near:
        return None
    first = max(near, key=lambda k: tracks[k].typical_level)
    lag, level = tracks[first].typical_us, tracks[first].typical_level
    order = [
        t.typical_us / lag
        for t in tracks
        if t.typical_level > FAINT * level
        and (
            _comes_twice(t, tracks, [tracks[first]], band)
            or (
                not is_early_and_weak(t, band)
                and not any(_is_lobe_of(t, tracks[k], band) for k in near)
            )
        )
    ]
    even = all(abs(k - round(k)) * lag < TWICE * band.length_us * max(round(k), 1) for k in order)
    if not even:
        return None
    if known.cut:  # the third over the second
        third = [t.typical_level for t in tracks if abs(t.typical_us / lag - 2.0) < 0.1]
        return first if third and max(third) > CONTACT_LEVEL * level else None
    lost = known.loss_np(tracks[first]) > LEAST_DAMPING
    return first if level > CONTACT_LEVEL or lost else None


def _is_lobe(track: Track, wanders: bool, others: list[Track], band: Band, known: Evidence) -> bool:
    """Return whether an early weak echo is rather the end of the front's own pulse."""
    level = track.typical_level
    # a front that was cut off is put back lower than it was
    early = _early_and_weak(track.typical_us, level / (CUT_SHORT if known.cut else 1.0), band)
    if not early and not may_be_ghost(track, band):
        return False
    # close behind a front that was cut off and restored, what is faint wanders too
    close = track.typical_us < CLOSE_REACH * band.length_us
    close = close and level < (GHOST_MOST if known.cut else GHOST_LEVEL)
    least = 0.5 if not wanders else 2.0
    if wanders and not close:
        return False
    later = [
        t
        for t in others
        if t.typical_level > (least if early else LOUDER) * level
        and t.typical_us > track.typical_us
    ]
    if not later or _has_multiples(track, later, others, band, known):
        return False
    # what is faint by the loss in the plate has lost its high frequencies first
    return early or known.loss_np(track) < LOST * float(np.log(1.0 / level))


def _has_multiples(
    track: Track, later: list[Track], others: list[Track], band: Band, known: Evidence
) -> bool:
    """Return whether an echo comes again at twice its lag.

    Both together tell how strongly the plate reflects: a faint echo with a loud multiple would
    be of a better mirror than there is.
    """
    # a lobe comes behind every echo, and so behind one at twice its own lag; and a louder echo
    # has multiples of its own
    level = track.typical_level
    lobes = [u.typical_us + track.typical_us for u in later]
    lobes += [2.0 * u.typical_us for u in later if u.typical_level > 2.0 * level]
    most = 0.9 if known.cut else min(0.9, MIRROR * level)
    return any(
        0.2 * level < t.typical_level < most * level
        and all(abs(t.typical_us - lobe) > TWICE * band.length_us for lobe in lobes)
        and abs(t.typical_us - 2.0 * track.typical_us) < TWICE * band.length_us
        and known.loss_np(t) > known.loss_np(track) - SHARPER
        for t in others
    )


def is_repeated(track: Track, others: list[Track], band: Band, known: Evidence) -> bool:
    """Return whether the plate's own multiple speaks for an echo."""
    rest = [t for t in others if t is not track]
    return _has_multiples(track, [], rest, band, known)


def _is_alone(
    track: Track,
    wanders: bool,
    tracks: list[Track],
    foreign: list[Track],
    band: Band,
    known: Evidence,
) -> bool:
    """Return whether an early weak echo is the only one that is not explained, and a lobe.

    Only the front's second arrival by way of the probe is louder, and there is no multiple.
    """
    louder = [t for t in foreign if t.typical_level > LONE_LEVEL * track.typical_level]
    if wanders or not is_early_and_weak(track, band) or not louder:
        return False
    return not is_repeated(track, tracks, band, known)


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


def may_be_ghost(track: Track, band: Band) -> bool:
    """Return whether an echo is so early and faint that it may come from within the probe."""
    near = track.typical_us < GHOST_REACH * band.length_us
    return near and track.typical_level < GHOST_MOST


def is_smeared(track: Track, band: Band) -> bool:
    """Return whether an echo is so near and faint that it is left of the front's compression."""
    reach, most = SMEARED
    return track.typical_us < reach * band.length_us and track.typical_level < most


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
    around = predicted(track.lag_us, track.present, near, positions_mm)
    known = track.present & np.isfinite(around)
    if not known.any():
        return 0.0, False
    off = (track.lag_us - around)[known]
    # a track that jumps from one still echo to another does not wander
    wide = robust_sd(track.lag_us[known & largest_piece(track, near, band.length_us)])
    wanders = wide > WANDERS / band.centre_mhz and robust_sd(off) < 0.5 * wide
    return float((np.abs(off) < AGREES * band.length_us).mean()), wanders
