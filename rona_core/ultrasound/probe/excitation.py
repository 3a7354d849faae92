"""Excitation and impulse response of the transducer, as spectra.

Shared by detection and by the virtual world: a laboratory records both on a reference block.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from rona_core.devices.settings import Excitation, PulseShape
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.probe.materials import Complexes
from rona_core.ultrasound.probe.probe_model import ProbeModel

HALF_POWER_STEPS = 60  # of the bisection for the width
REACH, SCAN = 6.0, 4001  # widths to either side, and samples, in which the band is sought


@dataclass(frozen=True)
class Pulse:
    """Poles (place, order) and late packets (size, cycles after the first).

    Places count in half widths of a pole, before the scaling, from the centre frequency.
    """

    poles: tuple[tuple[float, int], ...]
    lobes: tuple[tuple[float, float], ...]

    def resonance(self, offsets: Floats) -> Complexes:
        """Return the response (f,) at offsets from the centre over the -6 dB band; 1 at 0."""
        return self._poles(offsets * self._scale) / self._poles(np.zeros(1))

    def _poles(self, x: Floats) -> Complexes:
        response = np.ones(len(x), dtype=np.complex128)
        for place, order in self.poles:
            response *= (1.0 + 1j * (x - place)) ** -order
        return response

    @cached_property
    def _scale(self) -> float:
        """Half widths of a pole in the -6 dB band of the shape."""
        x = np.linspace(-REACH, REACH, SCAN)
        level = np.abs(self._poles(x))
        loud = x[level >= 0.5 * level.max()]
        low, high = (self._edge(float(x0), side) for x0, side in ((loud[0], -1), (loud[-1], 1)))
        return high - low

    def _edge(self, inside: float, side: int) -> float:
        half = 0.5 * float(np.abs(self._poles(np.linspace(-REACH, REACH, SCAN))).max())
        near, far = inside, inside + side * 2.0 * REACH / (SCAN - 1)
        for _ in range(HALF_POWER_STEPS):
            middle = 0.5 * (near + far)
            loud = np.abs(self._poles(np.array([middle])))[0] >= half
            near, far = (middle, far) if loud else (near, middle)
        return near


# A steep rise and a slow decay; well damped with a short echo of the backing; two humps of a
# matching layer; a light backing that rings on.
PULSES: dict[PulseShape, Pulse] = {
    "resonant": Pulse(((0.0, 6),), ((-0.10, 2.8),)),
    "damped": Pulse(((0.0, 9),), ((0.20, 1.7), (-0.07, 4.2))),
    "double": Pulse(((-1.0, 3), (1.0, 3)), ((-0.12, 3.4),)),
    "ringing": Pulse(((-0.2, 2), (0.2, 3)), ((-0.22, 2.3), (0.12, 4.9))),
}


GRID = 4096  # samples of the time axis that starts with the emission
BAND = (0.15, 1.95)  # modelled frequencies over the centre frequency
CHIRP_TAPER = 0.3  # Tukey


def grid_frequencies_mhz(probe: ProbeModel, samples: int = GRID) -> Floats:
    """Return the frequencies (samples // 2 + 1,) of a real transform at the probe's sampling."""
    return np.arange(samples // 2 + 1, dtype=np.float64) * (probe.sampling_mhz / samples)


def in_band(probe: ProbeModel, frequencies_mhz: Floats) -> np.typing.NDArray[np.bool_]:
    """Return which frequencies the probe can hear at all."""
    relative = frequencies_mhz / probe.centre_mhz
    return (relative > BAND[0]) & (relative < BAND[1])


def transducer_response(probe: ProbeModel, frequencies_mhz: Floats) -> Complexes:
    """Return the two-way response (f,) of the crystal: causal, several lobes, 1 in mid-band."""
    f, fc = frequencies_mhz, probe.centre_mhz
    pulse = PULSES[probe.pulse_shape]
    resonance = pulse.resonance((f - fc) / (probe.bandwidth * fc))
    lobes = np.ones(len(f), dtype=np.complex128)
    for size, cycles in pulse.lobes:
        lobes += size * np.exp(-2j * np.pi * f * cycles / fc)
    low, high = BAND[0] * fc, BAND[1] * fc
    edge = np.clip(np.minimum((f - low) / (0.2 * fc), (high - f) / (0.35 * fc)), 0.0, 1.0)
    return resonance * lobes * np.sin(0.5 * np.pi * edge) ** 2


def chirp(probe: ProbeModel) -> Floats:
    """Return the sampled linear-FM emission (samples,), amplitude 1."""
    n = round(probe.chirp_length_us * probe.sampling_mhz)
    t = np.arange(n) / probe.sampling_mhz
    rate = probe.chirp_band_mhz / probe.chirp_length_us
    phase = 2.0 * np.pi * ((probe.centre_mhz - probe.chirp_band_mhz / 2.0) * t + rate * t**2 / 2.0)
    # Tukey's window; that of scipy.signal imports the whole of scipy.stats
    x = 2.0 * np.arange(n) / CHIRP_TAPER / (n - 1)
    ramps = np.minimum(x - 1.0, 0.0) + np.maximum(x + (1.0 - 2.0 / CHIRP_TAPER), 0.0)
    return np.sin(phase) * (0.5 * (1.0 + np.cos(np.pi * ramps)))


@lru_cache(maxsize=16)
def excitation_spectrum(probe: ProbeModel, excitation: Excitation) -> Complexes:
    """Return the spectrum (GRID // 2 + 1,) of what drives the transducer: 1 for a pulse.

    Raises:
        InvalidInputError: the excitation is neither a pulse nor a chirp.
    """
    if excitation == "pulse":
        return readonly(np.ones(GRID // 2 + 1, dtype=np.complex128))
    if excitation == "chirp":
        return readonly(np.fft.rfft(chirp(probe), GRID) / probe.sampling_mhz)
    raise InvalidInputError(f"excitation must be 'pulse' or 'chirp', not {excitation!r}")


def emission_spectrum(probe: ProbeModel, excitation: Excitation) -> Complexes:
    """Return the excitation times the transducer's response (GRID // 2 + 1,).

    Raises:
        InvalidInputError: the excitation is neither a pulse nor a chirp.
    """
    response = transducer_response(probe, grid_frequencies_mhz(probe))
    return excitation_spectrum(probe, excitation) * response
