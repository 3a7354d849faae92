"""Recorded lines aligned to their front wall, and the compression of long (swept) pulses.

All that is done behind the front wall takes one over the bandwidth for the length of a pulse. A
swept emission is not so short; the mean front, divided out, makes it so.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.recorded.band import Band, Complexes, filtered, inverse_filter
from rona_core.ultrasound.recorded.front_wall import FrontEchoes
from rona_core.ultrasound.recorded.template_learning import locate_echoes

PULSE_CONTINUES = 0.35  # of the mean front's peak: above it the pulse goes on
LONG = 2.6  # over 1 / bandwidth; rings and bursts are shorter at that level
MARGIN = 0.8  # of 1 / bandwidth, kept on either side
ONSET = 0.04  # of the peak, at which a pulse begins
REACH = 3.0  # of the comparison about the front, over the pulse length
CYCLES = (0, -1, 1, -2, 2)
KEPT = 0.9  # another cycle must leave less than this share of the misfit
SEARCH_CYCLES = 0.3
HALVES = (0, -1, 1, -2, 2, -3, 3)  # of cycles
GAINS = np.geomspace(1.0, 20.0, 24)  # of the whole front, over the limit that cut it off
FINE = 8
COMPARED = 24  # lines


@dataclass(frozen=True, slots=True, eq=False)
class RfSurvey:
    """The lines of one recording with every front at one sample, and what is known of all."""

    recorded: RecordedRf  # as it was written: sampling, start, positions
    clipped: Bools  # (n, samples) at a limit of the converter
    band: Band
    front: FrontEchoes
    lines: Complexes  # (n, samples) analytic, every front at sample ``zero`` with height 1
    zero: int

    @property
    def sampling_mhz(self) -> float:
        """Return the sampling rate."""
        return self.recorded.sampling_mhz

    @property
    def positions_mm(self) -> Floats | None:
        """Return the positions (n, 1 to 3) of the scans, where they are known."""
        return self.recorded.positions_mm


def align_fronts(
    z: Complexes, front: FrontEchoes, recorded: RecordedRf, clipped: Bools, band: Band
) -> RfSurvey:
    """Shift and scale analytic lines (n, samples) so that all fronts coincide with height 1."""
    rate = recorded.sampling_mhz
    front_sample = front.aligned.at_us * rate
    zero = int(min(np.rint(front_sample).min(), 8.0 * band.length_us * rate))
    zero = max(zero, round(2.0 * band.length_us * rate))
    size = z.shape[1]
    padded = size + zero + round(2.0 * band.length_us * rate)
    f = np.fft.fftfreq(padded, 1.0 / rate)
    shift_us = (front_sample - zero) / rate
    middle = np.median(front_sample[front.ok]) if front.ok.any() else 0.0
    kept = size - int(np.floor(middle)) + zero
    lines = np.zeros((len(z), min(kept, size)), dtype=np.complex128)
    peak = float(np.abs(np.fft.ifft(front.aligned.spectrum)).max())
    for start in range(0, len(z), 64):
        part = slice(start, start + 64)
        spectra = np.fft.fft(z[part], padded, axis=1)
        shifted = np.fft.ifft(spectra * np.exp(2j * np.pi * f * shift_us[part, None]), axis=1)
        lines[part] = shifted[:, : lines.shape[1]]
    level = np.where(front.ok, np.maximum(front.aligned.level, 1e-3), 1.0)
    lines = lines / np.maximum(peak * level, 1e-12)[:, None]
    return RfSurvey(recorded, clipped, band, front, lines, zero)


def least_lag_us(survey: RfSurvey) -> float:
    """Return the lag from which echoes are sought: not within the rest of a clipped front."""
    front, band, clipped = survey.front, survey.band, survey.clipped
    ends: list[float] = []
    for row in np.flatnonzero(front.ok & clipped.any(axis=1)):
        lag = np.flatnonzero(clipped[row]) / survey.sampling_mhz - front.aligned.at_us[row]
        end = 0.0
        for value in lag[lag > -band.length_us]:
            if value > end + 0.5 * band.length_us:
                break
            end = max(end, value)
        ends.append(end)
    after = float(np.median(ends)) + 0.8 * band.length_us if ends else 0.0
    return max(band.length_us, after if 2 * len(ends) > front.ok.sum() else 0.0)


def pulse_delay_us(survey: RfSurvey) -> float:
    """Return the time from the onset of the mean front to the point at which it is timed."""
    ok, zero = survey.front.ok, survey.zero
    if not ok.any():
        return 0.0
    envelope = np.abs(survey.lines[ok].mean(axis=0))[: zero + 1]
    faint = envelope < ONSET * envelope[-1]
    return float(np.argmax(faint[::-1]) if faint.any() else zero) / survey.sampling_mhz


def learn_long_pulse(survey: RfSurvey) -> Complexes | None:
    """Return the mean front (samples,) where it is long for its band, otherwise None.

    A pulse with multiples behind it is no long one: there are dips between them.
    """
    front, zero = survey.front, survey.zero
    if not front.ok.any():
        return None
    mean: Complexes = np.asarray(survey.lines[front.ok].mean(axis=0), dtype=np.complex128)
    envelope = np.abs(mean)
    length = survey.band.length_us * survey.sampling_mhz
    near = slice(max(0, round(zero - length)), round(zero + 1.5 * length))
    faint = envelope < PULSE_CONTINUES * envelope[near].max()
    before, behind = faint[:zero][::-1], faint[zero:]
    first = zero - int(np.argmax(before)) if before.any() else 0
    last = zero + int(np.argmax(behind)) if behind.any() else len(mean)
    if last - first < LONG * length:
        return None
    margin = round(MARGIN * length)
    index = np.arange(len(mean))
    taper = np.clip((index - first + margin) / margin, 0, 1)
    taper = taper * np.clip((last + margin - index) / margin, 0, 1)
    return np.asarray(mean * taper, dtype=np.complex128)


def compress_pulse(
    z: Complexes, pulse: Complexes, zero: int, sampling_mhz: float, band: Band
) -> Complexes:
    """Return lines (n, samples) in which every such pulse is short, where its front was timed."""
    padded = 2 * z.shape[1]
    f: Floats = np.fft.fftfreq(padded, 1.0 / sampling_mhz).astype(np.float64)
    whole = np.zeros(padded, dtype=np.complex128)
    whole[: len(pulse)] = pulse
    spectrum = np.fft.fft(np.roll(whole, -zero))
    return filtered(z, inverse_filter(spectrum, f, band))


def settle_clipped(rf: Floats, z: Complexes, survey: RfSurvey) -> FrontEchoes:
    """Return the fronts with those of clipped lines at the cycle that explains the line best.

    Args:
        rf: Lines (n, samples) as they were recorded.
        z: Analytic lines with the clipped samples restored.
        survey: The lines aligned to the fronts so far.
    """
    front, band, rate = survey.front, survey.band, survey.sampling_mhz
    clipped, lines, zero = survey.clipped, survey.lines, survey.zero
    rows = np.flatnonzero(front.ok & clipped.any(axis=1))
    if not len(rows):
        return front
    at = front.aligned.at_us * rate
    reach = round(REACH * band.length_us * rate)
    cycle = rate / band.centre_mhz
    mean = CubicSpline(np.arange(lines.shape[1]), lines[front.ok].mean(axis=0).real)
    moved = at.copy()
    for row in rows:
        index = np.arange(max(0, round(at[row]) - reach), min(rf.shape[1], round(at[row]) + reach))
        line = rf[row] - np.median(rf[row])
        if not clipped[row, index].any():
            continue
        scale = float(np.abs(z[row, index]).max())
        misfits: list[float] = []
        for number in CYCLES:
            place = np.clip(index - at[row] - number * cycle + zero, 0, lines.shape[1] - 1)
            model = np.clip(scale * mean(place), line.min(), line.max())
            misfits.append(float(((line[index] - model) ** 2).sum()))
        best = int(np.argmin(misfits))
        if misfits[best] < KEPT * misfits[0]:
            moved[row] += CYCLES[best] * cycle
    if (moved == at).all():
        return front
    # all again with the one template, so that every front has the same point of time
    centers = np.rint(moved).astype(np.int64)
    search_us = SEARCH_CYCLES / band.centre_mhz
    aligned = locate_echoes(z, centers, front.aligned, rate, band, search_us=search_us)
    return replace(front, aligned=aligned)


def cut_fronts(survey: RfSurvey) -> Bools:
    """Return which lines (n,) have a front that was cut off."""
    return np.asarray(survey.front.ok & (samples_lost(survey, survey.front.aligned.at_us) > 0))


def fronts_are_cut(survey: RfSurvey) -> bool:
    """Return whether most of the fronts were cut off."""
    return are_most_cut(cut_fronts(survey), survey.front.ok)


def samples_lost(survey: RfSurvey, at_us: Floats) -> Ints:
    """Return how many samples (n,) were cut off of echoes at times (n,) from the first sample."""
    index = np.arange(survey.clipped.shape[1]) / survey.sampling_mhz
    near = np.abs(index - at_us[:, None]) < survey.band.length_us
    return (survey.clipped & near).sum(axis=1)


def are_most_cut(cut: Bools, present: Bools) -> bool:
    """Return whether most of the echoes that are present (n,) are among those cut off (n,)."""
    return bool(2 * cut.sum() > present.sum())


def half_cycles_off(survey: RfSurvey, cut: Bools, pulse: Complexes) -> int:
    """Return by how many half cycles a pulse must move (and turn over) to explain the fronts.

    The back wall's echo is whole where the front's was cut off, or lost less at least: with its
    loss taken back, moved, and cut off at the same limits it must give the recorded line.

    Args:
        survey: Lines aligned to the fronts, and as they were recorded.
        cut: Lines (n,) whose front was cut off.
        pulse: Spectrum (f,) of the whole pulse, its time 0 where the fronts were timed.
    """
    rf, band, sampling_mhz = survey.recorded.rf, survey.band, survey.sampling_mhz
    size = len(pulse)
    fine = np.zeros(FINE * size, dtype=np.complex128)
    fine[: size // 2] = pulse[: size // 2]
    wave = np.fft.fftshift(np.fft.ifft(fine).real)
    wave = wave / max(float(np.abs(wave).max()), 1e-12)
    place = (np.arange(len(wave)) - len(wave) // 2) / (FINE * sampling_mhz)
    reach = round(REACH * band.length_us * sampling_mhz)
    rows = np.flatnonzero(cut)
    rows = rows[np.linspace(0, len(rows) - 1, min(COMPARED, len(rows))).astype(int)]
    misfit = np.zeros(len(HALVES))
    for row in rows:
        at = float(survey.front.aligned.at_us[row])
        middle = round(at * sampling_mhz)
        index = np.arange(max(0, middle - reach), min(rf.shape[1], middle + reach))
        line = rf[row] - np.median(rf[row])
        low, high = float(line.min()), float(line.max())
        for number, halves in enumerate(HALVES):
            time = index / sampling_mhz - at + 0.5 * halves / band.centre_mhz
            model = (-1.0) ** halves * np.interp(time, place, wave, 0.0, 0.0)
            scaled = np.clip(max(high, -low) * GAINS[:, None] * model, low, high)
            misfit[number] += float(((line[index] - scaled) ** 2).sum(axis=1).min())
    best = int(np.argmin(misfit))
    return HALVES[best] if misfit[best] < KEPT * misfit[HALVES.index(0)] else 0
