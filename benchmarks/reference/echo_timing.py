"""Timing of one echo in white noise: Cramér-Rao bounds, and a matched filter in single precision.

The bounds are what the scatter of detection is held against; the filter shows how fast one can be.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.single.inner_echo import bone_filter
from rona_core.ultrasound.detection.single.matched_filter import Template
from rona_core.ultrasound.detection.single.time_of_flight import Fisher
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.materials import Complexes, Material


@dataclass(frozen=True, slots=True)
class TimeBound:
    """The least standard deviations of a time of flight."""

    coherent_us: float
    envelope_us: float


def spectrum_bound(
    spectrum: Complexes, frequencies_mhz: Floats, noise: float, grid: int = GRID
) -> TimeBound:
    """Return the bounds for an echo in white noise.

    Args:
        spectrum: Of the echo (f,), bins of a real transform over ``grid`` samples.
        frequencies_mhz: Of the bins (f,).
        noise: RMS of the noise in each sample, above 0.
        grid: Samples of that transform.

    Raises:
        InvalidInputError: no noise, or no echo.
    """
    if not noise > 0.0:
        raise InvalidInputError(f"a bound needs noise above 0, not {noise}")
    if not np.any(spectrum):
        raise InvalidInputError("a bound needs an echo: the spectrum is 0 everywhere")
    weights = np.full(len(frequencies_mhz), 1.0 / (grid * noise**2))
    fisher = Fisher.of(spectrum, weights, frequencies_mhz)
    return TimeBound(
        float(1.0 / np.sqrt(2.0 * fisher.coherent)), float(1.0 / np.sqrt(2.0 * fisher.envelope))
    )


def inner_bound(
    template: Template,
    bone: Material,
    thickness_mm: float,
    inner_snr_db: float,
    emitted: Template | None = None,
) -> TimeBound:
    """Return the bounds of the time of an inner echo.

    Args:
        template: Of the probe's pulse: the signal-to-noise ratio is that of the pulse.
        bone: Whose loss the echo has suffered.
        thickness_mm: Of the bone.
        inner_snr_db: Peak of the inner echo over the rms of the noise in the -6 dB band.
        emitted: The template of what is sent, with the same noise; None: the pulse.
    """
    noise = inner_noise(template, bone, thickness_mm, inner_snr_db)
    sent = template if emitted is None else emitted
    return spectrum_bound(bone_filter(sent, bone, thickness_mm), sent.frequencies_mhz, noise)


def inner_noise(
    template: Template, bone: Material, thickness_mm: float, inner_snr_db: float
) -> float:
    """Return the rms of white noise that an inner echo has this ratio to, in the -6 dB band."""
    echo = np.zeros(GRID // 2 + 1, dtype=np.complex128)
    echo[template.bins] = bone_filter(template, bone, thickness_mm)
    peak = float(np.abs(np.fft.irfft(echo, GRID)).max())
    probe = template.probe
    band = probe.bandwidth * probe.centre_mhz / (probe.sampling_mhz / 2.0)
    return peak * 10.0 ** (-inner_snr_db / 20.0) / float(np.sqrt(band))


def peak_times(template: Template, rf: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the time (n,) of the largest matched-filter envelope in records (n, samples).

    In single precision, to a sample of the baseband, after the start of the record.
    """
    n = 2 ** int(np.ceil(np.log2(2 * rf.shape[1])))
    f = np.arange(n // 2 + 1) * (template.probe.sampling_mhz / n)
    reference = np.interp(f, template.frequencies_mhz, template.spectrum, left=0.0, right=0.0)
    band = np.flatnonzero(reference)
    size = 2 ** int(np.ceil(np.log2(2 * len(band))))
    spectra = np.fft.rfft(rf, n, axis=1)[:, band]
    compressed = np.fft.ifft(spectra * np.conj(reference[band]).astype(np.complex64), size, axis=1)
    power = compressed.real**2 + compressed.imag**2
    step = n / (size * template.probe.sampling_mhz)
    return (np.argmax(power, axis=1) * step).astype(np.float32)
