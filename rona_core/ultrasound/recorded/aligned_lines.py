"""Recorded lines aligned to their front wall."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.recorded.band import Band, Complexes
from rona_core.ultrasound.recorded.front_wall import FrontEchoes

BEFORE_LENGTHS, MOST_BEFORE_LENGTHS = 3.0, 8.0  # of the pulse, kept in front of the front wall
PULSE_CONTINUES = 0.35  # of the mean front's peak: above it the pulse goes on
LONGEST_LENGTHS = 5.0  # of 1 / bandwidth; more is a swept emission, not compressed
FLAT_TOP, FLAT_LENGTHS = 0.6, 1.75  # share of the peak, pulse lengths above it
ONSET = 0.04  # of the peak, at which a pulse begins


@dataclass(frozen=True, slots=True, eq=False)
class RfSurvey:
    """The lines of one recording with every front at one sample."""

    recorded: RecordedRf  # as it was written: sampling, start, positions
    band: Band
    front: FrontEchoes
    lines: Complexes  # (n, samples) analytic, every front at sample ``zero`` with height 1
    zero: int
    cut: bool  # most fronts stand at a limit of the converter, or are as flat as if they did

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
    """Shift and scale analytic lines (n, samples) so that all fronts coincide with height 1.

    Args:
        z: Analytic lines (n, samples).
        front: In each of them.
        recorded: As it was written.
        clipped: Samples (n, samples) at a limit of the converter.
        band: Of the echoes.
    """
    rate = recorded.sampling_mhz
    front_sample = front.aligned.at_us * rate
    length = band.length_us * rate
    zero = int(min(np.rint(front_sample).min(), MOST_BEFORE_LENGTHS * length))
    zero = max(zero, round(BEFORE_LENGTHS * length))
    size = z.shape[1]
    padded = size + zero + round(2.0 * length)
    f = np.fft.fftfreq(padded, 1.0 / rate)
    shift_us = (front_sample - zero) / rate
    middle = np.median(front_sample[front.ok]) if front.ok.any() else 0.0
    kept = size - int(np.floor(middle)) + zero
    lines: Complexes = np.zeros((len(z), min(kept, size)), dtype=np.complex128)
    peak = float(np.abs(np.fft.ifft(front.aligned.spectrum)).max())
    for start in range(0, len(z), 64):
        part = slice(start, start + 64)
        spectra = np.fft.fft(z[part], padded, axis=1)
        shifted = np.fft.ifft(spectra * np.exp(2j * np.pi * f * shift_us[part, None]), axis=1)
        lines[part] = shifted[:, : lines.shape[1]]
    level = np.where(front.ok, np.maximum(front.aligned.level, 1e-3), 1.0)
    lines = lines / np.maximum(peak * level, 1e-12)[:, None]
    near = np.abs(np.arange(size) - front_sample[:, None]) < 2.0 * length
    cut = bool(2 * (front.ok & (clipped & near).any(axis=1)).sum() > front.ok.sum())
    if not cut and front.ok.any():  # noise may hide the limit, not that the pulse has a flat top
        cut = _extent(lines[front.ok].mean(axis=0), zero, length, FLAT_TOP) > FLAT_LENGTHS
    return RfSurvey(recorded, band, front, lines, zero, cut)


def is_swept(survey: RfSurvey) -> bool:
    """Return whether the mean front goes on for far longer than its bandwidth would have it."""
    mean = survey.lines[survey.front.ok].mean(axis=0)
    length = survey.band.length_us * survey.sampling_mhz
    return _extent(mean, survey.zero, length, PULSE_CONTINUES) > LONGEST_LENGTHS


def _extent(mean: Complexes, zero: int, length: float, share: float) -> float:
    """Return for how many pulse lengths the front at ``zero`` is above a share of its peak."""
    envelope = np.abs(mean)
    faint = envelope < share * envelope[: zero + round(length)].max()
    before, behind = faint[:zero][::-1], faint[zero:]
    first = int(np.argmax(before)) if before.any() else zero
    last = int(np.argmax(behind)) if behind.any() else len(behind)
    return (first + last) / length


def pulse_delay_us(survey: RfSurvey) -> float:
    """Return the time from the onset of the mean front to the point at which it is timed."""
    ok, zero = survey.front.ok, survey.zero
    if not ok.any():
        return 0.0
    envelope = np.abs(survey.lines[ok].mean(axis=0))[: zero + 1]
    faint = envelope < ONSET * envelope[-1]
    return float(np.argmax(faint[::-1]) if faint.any() else zero) / survey.sampling_mhz
