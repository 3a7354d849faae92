"""Pulses much longer than their bandwidth needs (chirps): learned from the fronts, and compressed.

Everything behind this step takes one over the bandwidth for the length of a pulse. A swept
emission is not so short; its mean over all fronts, divided out, makes it so.
"""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.recorded.band import Band, Complexes, filtered, inverse_filter
from rona_core.ultrasound.recorded.front_echo import FrontEchoes

LOUD = 0.35  # of the mean front: the pulse goes on
LONG = 2.6  # over 1 / bandwidth; rings and bursts are shorter at that level
MARGIN = 0.8  # of 1 / bandwidth, kept on either side


def learn_long_pulse(
    lines: Complexes, zero: int, front: FrontEchoes, sampling_mhz: float, band: Band
) -> Complexes | None:
    """Return the mean front (samples,) where it is long for its band, otherwise None.

    A pulse with multiples behind it is no long one: there are dips between them.

    Args:
        lines: Analytic lines (n, samples) with every front at sample ``zero``.
        zero: That sample.
        front: The fronts.
        sampling_mhz: Of the lines.
        band: Of the echoes.
    """
    if not front.ok.any():
        return None
    mean: Complexes = np.asarray(lines[front.ok].mean(axis=0), dtype=np.complex128)
    envelope = np.abs(mean)
    length = band.length_us * sampling_mhz
    near = slice(max(0, round(zero - length)), round(zero + 1.5 * length))
    faint = envelope < LOUD * envelope[near].max()
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


def compress(
    z: Complexes, pulse: Complexes, zero: int, sampling_mhz: float, band: Band
) -> Complexes:
    """Return lines (n, samples) in which every such pulse is short, where its front was timed."""
    padded = 2 * z.shape[1]
    f: Floats = np.fft.fftfreq(padded, 1.0 / sampling_mhz).astype(np.float64)
    whole = np.zeros(padded, dtype=np.complex128)
    whole[: len(pulse)] = pulse
    spectrum = np.fft.fft(np.roll(whole, -zero))
    return filtered(z, inverse_filter(spectrum, f, band))
