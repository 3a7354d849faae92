"""How well the time of an echo can be known: the bounds of Cramer and Rao, in closed form.

For an echo ``a B(f) exp(-2 pi j f t)`` in noise of known spectrum no unbiased estimate of ``t`` has
a smaller standard deviation. The coherent bound holds where the phase of the echo is known, the
envelope bound where it is not; they differ by the ratio of centre frequency to rms bandwidth.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.single.inner_echo import bone_filter
from rona_core.ultrasound.detection.single.matched_filter import Template
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.materials import Complexes, Material


@dataclass(frozen=True, slots=True)
class TimeBound:
    """The least standard deviations of a time of flight."""

    coherent_us: float
    envelope_us: float


@dataclass(frozen=True, slots=True, eq=False)
class Fisher:
    """What spectra B (n, f) under weights tell of the time of an echo of amplitude 1, each (n,).

    Information on the time is twice the moment times the amplitude squared.
    """

    energy: Floats  # sum of w |B|^2
    mean_rad_per_us: Floats  # mean angular frequency
    coherent: Floats  # second moment about 0
    envelope: Floats  # and about the mean

    @classmethod
    def of(cls, spectra: Complexes, weights: Floats, frequencies_mhz: Floats) -> "Fisher":
        """Return the moments of spectra (..., f); weights are one over the noise's power."""
        omega = 2.0 * np.pi * frequencies_mhz
        power = weights * np.abs(spectra) ** 2
        energy = power.sum(axis=-1)
        mean = (power * omega).sum(axis=-1) / energy
        coherent = (power * omega**2).sum(axis=-1)
        return cls(energy, mean, coherent, coherent - energy * mean**2)


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


def amplitude_bound(fisher: Fisher, amplitude: ArrayLike) -> tuple[Floats, Floats]:
    """Return coherent and envelope bounds (n,) in us for amplitudes (n,)."""
    twice = 2.0 * np.maximum(np.abs(np.asarray(amplitude, dtype=np.float64)), 1e-12) ** 2
    coherent = 1.0 / np.sqrt(twice * fisher.coherent)
    return coherent, 1.0 / np.sqrt(twice * np.maximum(fisher.envelope, 1e-12))
