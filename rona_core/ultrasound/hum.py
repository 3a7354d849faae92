"""A steady tone in recorded lines: interference that goes through a whole record.

Echoes are short, so that a tone which lies in their band is known from the stretches between them.
"""

import numpy as np

from rona_core.arrays import Bools, Floats
from rona_core.ultrasound.recorded_signal import Band, analytic

LOUD = 3.0  # over the usual envelope: an echo, no tone
LEAST_QUIET = 0.3  # of the samples
SHARE = 0.3  # of the power between echoes that a tone must have
FINE = 4
TONES = 2


def without_hum(rf: Floats, clipped: Bools, sampling_mhz: float, band: Band) -> Floats:
    """Return the lines (n, samples) without steady tones in the band, one frequency for all."""
    result = rf
    for _ in range(TONES):
        tone = _tone(result, clipped, sampling_mhz, band)
        if tone is None:
            break
        result = result - tone
    return result


def _tone(rf: Floats, clipped: Bools, sampling_mhz: float, band: Band) -> Floats | None:
    """Return the strongest tone between the echoes (n, samples), None where there is none."""
    every = max(1, len(rf) // 100)
    z = analytic(rf[::every], sampling_mhz, band)
    quiet = _quiet(z)
    if quiet.mean() < LEAST_QUIET:
        return None
    between = np.where(quiet, z, 0.0)
    padded = FINE * rf.shape[1]
    power = (np.abs(np.fft.fft(between, padded, axis=1)) ** 2).mean(axis=0)
    at = int(np.argmax(power[: padded // 2]))
    # a tone that fills what is quiet has its power once for each quiet sample
    tone = power[at] / float((quiet.sum(axis=1) ** 2).mean())
    if tone < SHARE * float((np.abs(between) ** 2).sum() / quiet.sum()):
        return None
    waves = np.exp(2j * np.pi * at / padded * np.arange(rf.shape[1]))
    result = np.zeros_like(rf)
    for start in range(0, len(rf), 64):
        part = slice(start, start + 64)
        z = analytic(rf[part], sampling_mhz, band)
        quiet = _quiet(z) & ~clipped[part]
        height = (z * np.conj(waves) * quiet).sum(axis=1) / np.maximum(quiet.sum(axis=1), 1)
        result[part] = (height[:, None] * waves).real
    return result


def _quiet(z: np.typing.NDArray[np.complex128]) -> Bools:
    envelope = np.abs(z)
    return np.asarray(envelope < LOUD * np.median(envelope, axis=1)[:, None])
