"""Lines with every front at one place, and the back wall among the echoes behind it."""

import numpy as np

from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.recorded.back_wall_choice import (
    WANDERS,
    Evidence,
    choose_back_wall,
    is_early_and_weak,
    is_repeated,
    is_smeared,
    may_be_ghost,
    steadiness,
)
from rona_core.ultrasound.recorded.back_wall_timing import SEARCH_CYCLES, match_echoes
from rona_core.ultrasound.recorded.band import Band, Complexes, filtered, inverse_filter
from rona_core.ultrasound.recorded.echo_tracks import (
    Track,
    find_peaks,
    follow,
    mended,
    neighbour_tree,
    neighbours,
)
from rona_core.ultrasound.recorded.front_echo import FrontEchoes
from rona_core.ultrasound.recorded.probe_reverberations import (
    comes_again,
    is_foreign,
    spread,
    without_foreign,
)
from rona_core.ultrasound.recorded.template_learning import align_echoes

LOCKED_REACH = 6.0  # over the pulse length
LOCKED = 0.5  # share of the power behind the front that is the same in all scans
SIDE_LOBE = 0.06
MANY = 8  # scans, from which on an average is one


def least_lag_us(clipped: Bools, front: FrontEchoes, sampling_mhz: float, band: Band) -> float:
    """Return the lag from which echoes are sought: not among what is left of a clipped front."""
    ends: list[float] = []
    for row in np.flatnonzero(front.ok & clipped.any(axis=1)):
        lag = np.flatnonzero(clipped[row]) / sampling_mhz - front.aligned.at_us[row]
        end = 0.0
        for value in lag[lag > -band.length_us]:
            if value > end + 0.5 * band.length_us:
                break
            end = max(end, value)
        ends.append(end)
    after = float(np.median(ends)) + 0.8 * band.length_us if ends else 0.0
    return max(band.length_us, after if 2 * len(ends) > front.ok.sum() else 0.0)


def align_fronts(
    z: Complexes, front: FrontEchoes, sampling_mhz: float, band: Band
) -> tuple[int, Complexes]:
    """Return the sample of the front, and lines moved so that every front is there, height 1."""
    at = front.aligned.at_us * sampling_mhz
    zero = int(min(np.rint(at).min(), 8.0 * band.length_us * sampling_mhz))
    zero = max(zero, round(2.0 * band.length_us * sampling_mhz))
    size = z.shape[1]
    padded = size + zero + round(2.0 * band.length_us * sampling_mhz)
    f = np.fft.fftfreq(padded, 1.0 / sampling_mhz)
    shift = (at - zero) / sampling_mhz
    kept = size - int(np.floor(np.median(at[front.ok]) if front.ok.any() else 0.0)) + zero
    lines = np.zeros((len(z), min(kept, size)), dtype=np.complex128)
    peak = float(np.abs(np.fft.ifft(front.aligned.spectrum)).max())
    for start in range(0, len(z), 64):
        part = slice(start, start + 64)
        spectra = np.fft.fft(z[part], padded, axis=1)
        moved = np.fft.ifft(spectra * np.exp(2j * np.pi * f * shift[part, None]), axis=1)
        lines[part] = moved[:, : lines.shape[1]]
    level = np.where(front.ok, np.maximum(front.aligned.level, 1e-3), 1.0)
    return zero, lines / np.maximum(peak * level, 1e-12)[:, None]


def find_back(
    recorded: RecordedRf,
    lines: Complexes,
    zero: int,
    front: FrontEchoes,
    band: Band,
    least_us: float,
    delay_us: float,
    cut: bool,
    long: bool,
) -> Track | None:
    """Return the echo that is the back wall, or None.

    Args:
        recorded: The file.
        lines: Analytic lines (n, samples) with every front at sample ``zero``.
        zero: That sample.
        front: The fronts.
        band: Of the echoes.
        least_us: Lag from which echoes are sought.
        delay_us: From the begin of a pulse to the point at which it is timed.
        cut: Whether the fronts were cut off.
        long: Whether the pulse was long and compressed, which leaves side lobes.
    """
    if not front.ok.any():
        return None
    rate = recorded.sampling_mhz
    tree = neighbour_tree(front.ok, recorded.positions_mm)
    near = neighbours(len(lines), recorded.positions_mm)
    front_us = recorded.start_us + front.aligned.at_us
    # a record that begins with ring-down begins with the emission
    timed = recorded.start_known or bool((front.quiet_from > 0).any())
    place = recorded.positions_mm
    last = recorded.rf.shape[1] - front.aligned.at_us * rate + zero
    ends = np.minimum(np.floor(last).astype(np.int64), lines.shape[1])

    def loss_np(track: Track) -> float:
        lag = np.where(track.there, track.lag_us, track.typical_us)
        echo = align_echoes(
            lines,
            np.rint(zero + lag * rate).astype(np.int64),
            track.there & front.ok,
            rate,
            band,
            search_us=SEARCH_CYCLES / band.centre_mhz,
        )
        return match_echoes(front.aligned, echo, band).loss_np_per_mhz * band.centre_mhz

    def again(track: Track) -> bool:
        return timed and comes_again(track, front_us, front.ok, band, delay_us)

    known = Evidence(timed, again, loss_np, cut)

    def choose(compressed: Complexes) -> tuple[Track | None, bool]:
        peaks = find_peaks(compressed, 1.0 / rate, zero, band, least_us, ends)
        peaks, moving = without_foreign(
            peaks, front_us, front.ok, timed, band, tree, place, delay_us, cut
        )
        tracks = [
            mended(track, peaks, near, place, band) for track in follow(peaks, tree, band, front.ok)
        ]
        foreign = [
            is_foreign(t, front_us, front.ok, timed, band, place, delay_us, cut) for t in tracks
        ]
        tracks, foreign = tracks + moving, foreign + [True] * len(moving)
        best = choose_back_wall(tracks, foreign, known, band, near, place)
        if best is None or is_smeared(tracks[best], band):
            return None, False
        return tracks[best], is_repeated(tracks[best], tracks, band, known)

    compressed = _compressed(lines, front, rate, band)
    plain, sure = choose(compressed)
    aside = long and plain is not None and _is_side_lobe(plain, band)
    if front.ok.sum() < MANY or (sure and not aside):
        return plain
    # what is the same in all scans may be the end of the front's own pulse
    still, _ = choose(_without_locked(compressed, zero, front.ok, rate, band))
    if still is None:
        return plain
    if plain is None:  # what is left of the pulse's end is no plate
        return None if may_be_ghost(still, band) else still
    if aside and still.typical_level > 0.5 * plain.typical_level:
        return still
    wanders = steadiness(still, near, place, band)[1]
    return still if _is_better(still, plain, wanders, least_us, band) else plain


def _is_better(still: Track, plain: Track, wanders: bool, least_us: float, band: Band) -> bool:
    """Return whether the second look tells the back wall better than the first.

    Args:
        still: Found behind what all scans have in common.
        plain: Found in the lines as they are.
        wanders: Whether the one of the second look moves against the front.
        least_us: Lag from which echoes are sought.
        band: Of the echoes.
    """
    same = abs(still.typical_us - plain.typical_us) < 0.3 * band.length_us
    cleaner = same and still.typical_level > 0.8 * plain.typical_level
    # a plate as even as that is the same in all scans itself
    cleaner = cleaner and spread(plain.lag_us[plain.there]) > WANDERS / band.centre_mhz
    lobe = is_early_and_weak(plain, band) and still.typical_level > 0.5 * plain.typical_level
    lobe = lobe and wanders
    # what is left of a front that was cut off is alike in all scans too
    rest = plain.typical_us < LOCKED_REACH * band.length_us and least_us > band.length_us
    rest = rest and still.typical_level > plain.typical_level
    earlier = still.typical_us < plain.typical_us - band.length_us
    earlier = earlier and still.typical_level > 0.5 * plain.typical_level
    earlier = earlier and not is_early_and_weak(still, band)
    return bool(cleaner or lobe or rest or earlier)


def _is_side_lobe(track: Track, band: Band) -> bool:
    near = track.typical_us < LOCKED_REACH * band.length_us
    return near and track.typical_level < SIDE_LOBE


def _compressed(lines: Complexes, front: FrontEchoes, sampling_mhz: float, band: Band) -> Complexes:
    """Return lines in which an echo like the front is one short lobe of height 1."""
    pulse = np.fft.ifft(front.aligned.spectrum)
    half = len(pulse) // 2
    padded = max(lines.shape[1] + 4 * round(band.length_us * sampling_mhz), half)
    f: Floats = np.fft.fftfreq(padded, 1.0 / sampling_mhz).astype(np.float64)
    whole = np.zeros(padded, dtype=np.complex128)
    whole[:half] = pulse[:half]
    whole[-half:] += pulse[-half:]
    spectrum = np.fft.fft(whole)
    weight = inverse_filter(spectrum, f, band)
    weight = weight / np.abs(np.fft.ifft(spectrum * weight)).max()
    weight = weight * float(np.abs(pulse).max())  # the lines are over the height of the front
    return filtered(lines, weight)


def _without_locked(
    compressed: Complexes, zero: int, ok: Bools, sampling_mhz: float, band: Band
) -> Complexes:
    """Return lines without what all have in common shortly behind the front."""
    last = min(compressed.shape[1], zero + round(LOCKED_REACH * band.length_us * sampling_mhz))
    part = compressed[ok, zero:last]
    mean = part.mean(axis=0)
    share = np.abs(mean) ** 2 / np.maximum((np.abs(part) ** 2).mean(axis=0), 1e-12)
    # softly, for an edge would be an echo
    soft = np.clip((share - LOCKED) / (1.0 - LOCKED), 0.0, 1.0) ** 0.5
    end = np.clip((last - zero - np.arange(last - zero)) / (band.length_us * sampling_mhz), 0, 1)
    result = compressed.copy()
    result[:, zero:last] -= mean * soft * end
    return result
