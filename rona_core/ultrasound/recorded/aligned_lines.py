"""Recorded lines aligned to their front wall, and the compression of long (swept) pulses.

All that is done behind the front wall takes one over the bandwidth for the length of a pulse. A
swept emission is not so short; the mean front, divided out, makes it so.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.recorded.band import Band, Complexes, filtered, inverse_filter
from rona_core.ultrasound.recorded.front_wall import FrontEchoes

PULSE_CONTINUES = 0.35  # of the mean front's peak: above it the pulse goes on
LONG = 2.6  # over 1 / bandwidth; rings and bursts are shorter at that level
MARGIN = 0.8  # of 1 / bandwidth, kept on either side
ONSET = 0.04  # of the peak, at which a pulse begins


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
