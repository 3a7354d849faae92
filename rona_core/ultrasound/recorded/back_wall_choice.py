"""Choice of the back wall of the first plate among the echoes behind the front.

Behind a plate lie its own multiples, a floor or a second plate, and the front seen again by way
of the probe; in front of its back wall lie the last lobes of the pulse and, in bone, layers.
"""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.ultrasound.recorded.aligned_lines import RfSurvey
from rona_core.ultrasound.recorded.band import Band
from rona_core.ultrasound.recorded.echo_tracks import (
    Peaks,
    Track,
    find_peaks,
    follow,
    largest_piece,
    mended,
    neighbour_tree,
    neighbours,
    predicted,
)
from rona_core.ultrasound.recorded.probe_reverberations import (
    FrontArrivals,
    is_reverberation,
    repeats_standoff,
    robust_sd,
)

LEAST_SHARE = 0.2  # of the loudest echo of the plate and what is behind it
CONTACT_LEVEL = 0.2  # of the second round trip in a plate, over the first
LOBE_REACH = 4.5  # of the pulse, over its length
NEAR_REACH = 2.6
LOBE_LEVEL = 0.22  # over the front; lobes of real pulses are below, later ones more so
LATE_LOBE_LEVEL = 0.13
GHOST_REACH = 9.0  # echoes from within the probe come later, and are fainter still
GHOST_LEVEL = 0.05
SMEARED = 2.0, 0.02  # within so many pulse lengths nothing so faint over the front is an echo
CUT_SHORT = 2.5
MIRROR = 30.0  # R / (1 - R^2) of steel in water is 8, and the field spreads
LONE_LEVEL = 1.0  # of the front's second arrival, over an echo that nothing else speaks for
FAINT = 0.05
FEW = 12  # scans, among which neighbours may be far apart
LOUD_SHARE = 0.5
PATCHED = 0.5  # share of a whole echo's scans that are in one piece
STEADY = 0.6  # share of scans that agree with their neighbours
AGREES = 0.25  # of the pulse length
WANDERS = 0.2  # cycles that a lobe may seem to move
TWICE = 0.25  # of the pulse length: how well a multiple fits


def choose_back_wall(
    tracks: list[Track], foreign: list[bool], again: list[bool], fronts: FrontArrivals, near: Ints
) -> int | None:
    """Return which track is the back wall: the first that is loud enough and explained by nothing.

    Args:
        tracks: Echoes behind the front.
        foreign: Which of them have nothing to do with the plate.
        again: Which of them are as late after the front as this is after the emission.
        fronts: In front of them.
        near: Neighbours (n, k) of each scan.
    """
    band = fronts.band
    others = [t for t, no in zip(tracks, foreign, strict=True) if no]
    candidates: list[int] = [
        k
        for k, no in enumerate(foreign)
        if not no and not any(_is_lobe_of(tracks[k], t, band) for t in others)
    ]
    first = _contact(tracks, again, fronts)
    if first is not None:
        return first
    if not candidates:
        return None
    judged = [steadiness(t, near, fronts.positions_mm, band) for t in tracks]
    full = max(float(tracks[k].present.sum()) for k in candidates)
    candidates = [k for k in candidates if tracks[k].present.sum() >= 0.5 * full]
    loudest = max(tracks[k].typical_level for k in candidates)
    # what is nearly as loud as anything is an echo, however it jumps from scan to scan
    candidates = [
        k
        for k in candidates
        if judged[k][0] >= STEADY
        or len(near) < FEW
        or tracks[k].typical_level >= LOUD_SHARE * loudest
    ]
    candidates = _without_patchwork(tracks, candidates, near, band)
    while candidates:
        loudest = max(tracks[k].typical_level for k in candidates)
        loud = [k for k in candidates if tracks[k].typical_level >= LEAST_SHARE * loudest]
        loud.sort(key=lambda k: tracks[k].typical_us)
        for k in loud:
            rest = [tracks[j] for j in candidates if j != k]
            wanders = judged[k][1]
            lobe = not wanders and _is_lobe(tracks[k], rest, fronts)
            if not lobe and (wanders or not _is_alone(tracks[k], tracks, others, fronts)):
                return k
        # all of them belong to the pulse: the plate is among what is fainter
        candidates = [k for k in candidates if k not in loud]
    return None


def _without_patchwork(
    tracks: list[Track], candidates: list[int], near: Ints, band: Band
) -> list[int]:
    """Return the echoes that are in one piece, or than which no such one is louder.

    A track pieced together from holes that lie one beside the other is no back wall.
    """
    if len(near) < FEW:
        return candidates
    step_us = band.length_us
    share = {
        k: largest_piece(tracks[k], near, step_us).sum() / tracks[k].present.sum()
        for k in candidates
    }
    even = max((tracks[k].typical_level for k in candidates if share[k] >= PATCHED), default=0.0)
    return [k for k in candidates if share[k] >= PATCHED or tracks[k].typical_level > even]


def _contact(tracks: list[Track], again: list[bool], fronts: FrontArrivals) -> int | None:
    """Return the echo that is the second round trip in a plate under the probe itself.

    Then nothing lies between emission and back wall: what was taken for the front is the back
    wall, and whatever follows comes at multiples of its time. Behind water the second arrival
    from the front is fainter.
    """
    near, band = [k for k, late in enumerate(again) if late], fronts.band
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
    if even and fronts.cut:  # the third over the second
        third = [t.typical_level for t in tracks if abs(t.typical_us / lag - 2.0) < 0.1]
        even, level = bool(third), max(third, default=0.0) / level
    return first if even and level > CONTACT_LEVEL else None


def _is_lobe(track: Track, others: list[Track], fronts: FrontArrivals) -> bool:
    """Return whether an early weak echo that stands still is the end of the front's own pulse."""
    level = track.typical_level
    # a front that was cut off is put back lower than it was
    known = level / (CUT_SHORT if fronts.cut else 1.0)
    if not _early_and_weak(track.typical_us, known, fronts.band):
        return False
    later = [t for t in others if t.typical_level > 0.5 * level and t.typical_us > track.typical_us]
    return bool(later) and not _has_multiples(track, later, others, fronts)


def _has_multiples(
    track: Track, later: list[Track], others: list[Track], fronts: FrontArrivals
) -> bool:
    """Return whether an echo comes again at twice its lag.

    Both together tell how strongly the plate reflects: a faint echo with a loud multiple would
    be of a better mirror than there is.
    """
    # a lobe comes behind every echo, and so behind one at twice its own lag; and a louder echo
    # has multiples of its own
    level, apart = track.typical_level, TWICE * fronts.band.length_us
    lobes = [u.typical_us + track.typical_us for u in later]
    lobes += [2.0 * u.typical_us for u in later if u.typical_level > 2.0 * level]
    most = 0.9 if fronts.cut else min(0.9, MIRROR * level)
    return any(
        0.2 * level < t.typical_level < most * level
        and all(abs(t.typical_us - lobe) > apart for lobe in lobes)
        and abs(t.typical_us - 2.0 * track.typical_us) < apart
        for t in others
    )


def _is_alone(
    track: Track, tracks: list[Track], foreign: list[Track], fronts: FrontArrivals
) -> bool:
    """Return whether an early weak echo is the only one that is not explained, and a lobe.

    Only the front's second arrival by way of the probe is louder, and there is no multiple.
    """
    louder = any(t.typical_level > LONE_LEVEL * track.typical_level for t in foreign)
    rest = [t for t in tracks if t is not track]
    early = is_early_and_weak(track, fronts.band)
    return early and louder and not _has_multiples(track, [], rest, fronts)


def _is_lobe_of(track: Track, main: Track, band: Band) -> bool:
    """Return whether an echo could be a lobe of another one that is before it."""
    after = track.typical_us - main.typical_us
    return after > 0 and _early_and_weak(after, track.typical_level / main.typical_level, band)


def is_early_and_weak(track: Track, band: Band) -> bool:
    """Return whether an echo could be a lobe of the front's own pulse."""
    return _early_and_weak(track.typical_us, track.typical_level, band)


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


def find_back_wall(survey: RfSurvey, pulse_delay_us: float) -> Track | None:
    """Return the echo of the back wall, or None.

    Args:
        survey: Lines aligned to their fronts.
        pulse_delay_us: From the begin of a pulse to the point at which it is timed.
    """
    recorded, front, band = survey.recorded, survey.front, survey.band
    if not front.ok.any():
        return None
    # a record that begins with ring-down begins with the emission
    timed = recorded.start_known or bool((front.quiet_from > 0).any())
    fronts = FrontArrivals(
        time_us=recorded.start_us + front.aligned.at_us,
        ok=front.ok,
        emission_known=timed,
        band=band,
        positions_mm=recorded.positions_mm,
        pulse_delay_us=pulse_delay_us,
    )
    peaks = _peaks_behind_front(survey)
    place = recorded.positions_mm
    tree, near = neighbour_tree(front.ok, place), neighbours(len(survey.lines), place)
    followed = follow(peaks, tree, band, front.ok)
    tracks = [mended(track, peaks, near, place, band) for track in followed]
    foreign = [is_reverberation(track, fronts) for track in tracks]
    again = [timed and repeats_standoff(track, fronts) for track in tracks]
    best = choose_back_wall(tracks, foreign, again, fronts, near)
    return None if best is None or is_smeared(tracks[best], band) else tracks[best]


def _peaks_behind_front(survey: RfSurvey) -> Peaks:
    rate, zero = survey.sampling_mhz, survey.zero
    last = survey.recorded.rf.shape[1] - survey.front.aligned.at_us * rate + zero
    ends = np.minimum(np.floor(last).astype(np.int64), survey.lines.shape[1])
    return find_peaks(survey.lines, 1.0 / rate, zero, survey.band, survey.band.length_us, ends)
