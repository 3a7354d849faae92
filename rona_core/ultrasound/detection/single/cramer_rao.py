"""Cramér-Rao bounds of the time of an echo, in closed form.

For an echo ``a B(f) exp(-2 pi j f t)`` in noise of known spectrum no unbiased estimate of ``t`` has
a smaller standard deviation. The coherent bound holds where the phase of the echo is known, the
envelope bound where it is not; they differ by the ratio of centre frequency to rms bandwidth.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.probe.materials import Complexes


@dataclass(frozen=True, slots=True, eq=False)
class Fisher:
    """Fisher information (n,) of spectra B (n, f) on the time of an echo of amplitude 1.

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


def amplitude_bound(fisher: Fisher, amplitude: ArrayLike) -> tuple[Floats, Floats]:
    """Return coherent and envelope bounds (n,) in us for amplitudes (n,)."""
    # Fisher information on t: 2 a^2 sum w |B|^2 omega^2
    twice = 2.0 * np.maximum(np.abs(np.asarray(amplitude, dtype=np.float64)), 1e-12) ** 2
    coherent = 1.0 / np.sqrt(twice * fisher.coherent)
    return coherent, 1.0 / np.sqrt(twice * np.maximum(fisher.envelope, 1e-12))
