"""Thickness of a plate from recorded lines of which nothing else is known.

The band, the pulse, where the front is, and what the back wall's echo looks like are all learned
from the lines; only the sound speed must be given.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import Bools, Floats, Ints, readonly
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.rf_files import RecordedRf
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.ultrasound.back_wall import choose_back_wall, is_early_and_weak
from rona_core.ultrasound.clipped_front import settle_clipped
from rona_core.ultrasound.echo_tracks import (
    Track,
    find_peaks,
    follow,
    mended,
    neighbour_tree,
    neighbours,
)
from rona_core.ultrasound.recorded_back import BackEchoes, refine_back
from rona_core.ultrasound.recorded_front import FrontEchoes, find_recorded_fronts
from rona_core.ultrasound.recorded_signal import (
    Band,
    Complexes,
    analytic,
    check_lines,
    find_band,
    find_clipped,
    restore_clipped,
)

OK, NO_FRONT, NO_BACK, UNSURE = range(4)
SPEEDS_MM_PER_US = (0.5, 10.0)
COMPRESSED_FLOOR = 0.02  # of the peak power, added before dividing
LOCKED = 0.5  # share of the power behind the front that is the same in all scans
LOCKED_REACH = 6.0  # over the pulse length
SETTLINGS = 3  # of clipped fronts; the mean front gets sharper each time
MANY = 8  # scans, from which on an average is one


@dataclass(frozen=True, slots=True, eq=False)
class RecordedDetection:
    """Front and back of the plate in each recorded line (n,)."""

    front_us: Floats  # after the emission, or after the first sample where that is not known
    lag_us: Floats  # from the front to the back wall and back; 0 where not ok
    thickness_mm: Floats  # 0 where not ok
    ok: Bools
    flag: Ints  # 0 ok, 1 no front, 2 no back wall, 3 unsure
    front_level: Floats  # over the mean front
    likeness: Floats  # correlation of the back echo with the mean one, -1 to 1
    sigma_mm: Floats  # predicted from the noise; 0 where not ok
    clipped: Bools  # lines with samples at a limit of the converter
    centre_mhz: float
    width_mhz: float  # at -6 dB
    back_level: float  # over the front, typical
    back_inverted: bool  # against the front
    sound_speed_mm_per_us: float

    def __len__(self) -> int:
        return len(self.flag)


def detect_recorded(
    recorded: RecordedRf,
    sound_speed_mm_per_us: float,
    *,
    prior_mhz: float | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RecordedDetection:
    """Return the thickness of the first plate in each line.

    Args:
        recorded: Lines from a file.
        sound_speed_mm_per_us: In the plate; thickness is proportional to it.
        prior_mhz: Nominal frequency of the probe, where it is known.
        progress: Told the share that is done.
        cancel: Asked between steps.

    Raises:
        InvalidInputError: an impossible speed, or lines that are none.
        DegenerateGeometryError: there is no echo in them.
        CancelledError: ``cancel`` said so.
    """
    low, high = SPEEDS_MM_PER_US
    if not low <= sound_speed_mm_per_us <= high:
        raise InvalidInputError(
            f"the sound speed must be {low} to {high} mm/us: {sound_speed_mm_per_us:g}"
        )
    check_lines(recorded.rf)
    told = _Steps(progress, cancel)
    rf, rate = recorded.rf, recorded.sampling_mhz
    clipped = find_clipped(rf)
    band = find_band(rf, clipped, rate, prior_mhz)
    told(0.1)
    z = analytic(restore_clipped(rf, clipped, rate, band), rate, band)
    told(0.3)
    front = find_recorded_fronts(z, rate, recorded.start_us, recorded.start_known, band)
    told(0.5)
    zero, lines = _behind(z, front, rate, band)
    for _ in range(SETTLINGS if clipped.any() else 0):
        settled = settle_clipped(rf, clipped, z, front, lines, zero, rate, band)
        if settled is front:
            break
        front = settled
        zero, lines = _behind(z, front, rate, band)
    least = _least_lag_us(clipped, front, rate, band)
    back = _find_back(recorded, lines, zero, front, band, least)
    told(0.7)
    found = None if back is None else refine_back(lines, zero, front, back, rate, band, recorded)
    told(1.0)
    cut: Bools = np.asarray(clipped.any(axis=1))
    return _judged(recorded, front, found, cut, band, sound_speed_mm_per_us)


def detect_lines(
    rf: ArrayLike, sampling_mhz: float, sound_speed_mm_per_us: float
) -> RecordedDetection:
    """Return the thickness of the first plate in lines (n, samples) of which no more is known.

    Raises:
        InvalidInputError: an impossible speed, or lines that are none.
        DegenerateGeometryError: there is no echo in them.
    """
    lines = np.asarray(rf, dtype=np.float64)
    return detect_recorded(
        RecordedRf("lines", lines, sampling_mhz, 0.0, False, None), sound_speed_mm_per_us
    )


class _Steps:
    def __init__(self, progress: Progress, cancel: Cancel) -> None:
        self._progress, self._cancel = progress, cancel

    def __call__(self, share: float) -> None:
        if self._cancel():
            raise CancelledError("the detection of echoes was cancelled")
        self._progress(share)


def _least_lag_us(clipped: Bools, front: FrontEchoes, sampling_mhz: float, band: Band) -> float:
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


def _behind(
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


def _find_back(
    recorded: RecordedRf,
    lines: Complexes,
    zero: int,
    front: FrontEchoes,
    band: Band,
    least_us: float,
) -> Track | None:
    """Return the echo that is the back wall, or None."""
    if not front.ok.any():
        return None
    rate = recorded.sampling_mhz
    tree = neighbour_tree(front.ok, recorded.positions_mm)
    near = neighbours(len(lines), recorded.positions_mm)
    front_us = recorded.start_us + front.aligned.at_us

    def choose(compressed: Complexes) -> Track | None:
        peaks = find_peaks(compressed, 1.0 / rate, zero, band, least_us)
        tracks = [
            mended(track, peaks, near, recorded.positions_mm, band)
            for track in follow(peaks, tree, band, front.ok)
        ]
        best = choose_back_wall(
            tracks, front_us, front.ok, recorded.start_known, band, near, recorded.positions_mm
        )
        return None if best is None else tracks[best]

    compressed = _compressed(lines, front, rate, band)
    plain = choose(compressed)
    if front.ok.sum() < MANY:
        return plain
    # what is the same in all scans may be the end of the front's own pulse
    still = choose(_without_locked(compressed, zero, front.ok, rate, band))
    if plain is None or still is None:
        return plain if still is None else still
    same = abs(still.typical_us - plain.typical_us) < 0.3 * band.length_us
    cleaner = same and still.typical_level > 0.8 * plain.typical_level
    lobe = is_early_and_weak(plain, band) and still.typical_level > 0.5 * plain.typical_level
    return still if cleaner or lobe else plain


def _compressed(lines: Complexes, front: FrontEchoes, sampling_mhz: float, band: Band) -> Complexes:
    """Return lines in which an echo like the front is one short lobe of height 1."""
    size = lines.shape[1]
    padded = size + 4 * round(band.length_us * sampling_mhz)
    f = np.fft.fftfreq(padded, 1.0 / sampling_mhz)
    pulse = np.fft.ifft(front.aligned.spectrum)
    half = len(pulse) // 2
    whole = np.zeros(padded, dtype=np.complex128)
    whole[: min(half, padded)] = pulse[: min(half, padded)]
    whole[-half:] += pulse[-half:]
    spectrum = np.fft.fft(whole)
    power = np.abs(spectrum) ** 2
    target = np.where(f > 0, np.exp(-2.77 * ((f - band.centre_mhz) / band.width_mhz) ** 2), 0.0)
    weight = target * np.conj(spectrum) / (power + COMPRESSED_FLOOR * power.max())
    weight = weight / np.abs(np.fft.ifft(spectrum * weight)).max()
    weight = weight * float(np.abs(pulse).max())  # the lines are over the height of the front
    compressed = np.zeros_like(lines)
    for start in range(0, len(lines), 64):
        part = slice(start, start + 64)
        spectra = np.fft.fft(lines[part], padded, axis=1)
        compressed[part] = np.fft.ifft(spectra * weight, axis=1)[:, :size]
    return compressed


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


def _judged(
    recorded: RecordedRf,
    front: FrontEchoes,
    back: BackEchoes | None,
    clipped: Bools,
    band: Band,
    speed: float,
) -> RecordedDetection:
    n = len(recorded)
    nothing, no = np.zeros(n), np.zeros(n, dtype=np.bool_)
    heard = no if back is None else back.heard
    sure = no if back is None else back.sure
    flag = np.select([~front.ok, ~heard, ~sure], [NO_FRONT, NO_BACK, UNSURE], OK)
    ok = flag == OK
    lag = nothing if back is None else np.where(ok, back.lag_us, 0.0)
    sigma = nothing if back is None else np.where(ok, back.sigma_us * speed / 2.0, 0.0)
    return RecordedDetection(
        front_us=readonly(recorded.start_us + front.aligned.at_us),
        lag_us=readonly(lag),
        thickness_mm=readonly(lag * speed / 2.0),
        ok=readonly(ok),
        flag=readonly(flag.astype(np.int64)),
        front_level=readonly(front.aligned.level.copy()),
        likeness=readonly(nothing if back is None else back.likeness.copy()),
        sigma_mm=readonly(sigma),
        clipped=readonly(clipped),
        centre_mhz=band.centre_mhz,
        width_mhz=band.width_mhz,
        back_level=0.0 if back is None else back.level,
        back_inverted=back is not None and back.inverted,
        sound_speed_mm_per_us=speed,
    )
