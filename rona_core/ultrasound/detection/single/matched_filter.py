"""Matched filter of whole surveys: traces to compressed complex envelopes.

The template is what a laboratory records on a flat reference block: excitation, transducer and
line. Everything is done in the band of the probe and mixed down to its centre frequency.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.probes import PROBE_DATA
from rona_core.devices.settings import Excitation
from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.probe.beam import mirror_spectrum
from rona_core.ultrasound.probe.excitation import (
    GRID,
    emission_spectrum,
    grid_frequencies_mhz,
    in_band,
)
from rona_core.ultrasound.probe.materials import GEL, TABLE, Complexes
from rona_core.ultrasound.probe.probe_model import FULL_SCALE_SHARE, ProbeModel

BONE_MRAYL, GEL_MRAYL = (m.speed_mm_per_us * m.density_g_per_cm3 for m in (TABLE, GEL))
BONE_REFLECTION = (BONE_MRAYL - GEL_MRAYL) / (BONE_MRAYL + GEL_MRAYL)  # nominal, from gel
EQUAL_BAND = 0.55  # -6 dB width of the equalised echo over the centre frequency
NOISE_SCANS, NOISE_STEPS = 64, 2  # looked at for the noise; steps for each doubling of it
NOISE_FLOOR = 1.0  # equalising also stops this far (power) above the noise
Record = TypeVar("Record", bound=Any)  # an array (n, ...), or a dataclass of such
AT_ONCE = 64  # traces whose whole spectra are held at a time: they are large
EVERY = 16  # frequencies that share a factor of a shift
COMPRESSED = 2048  # samples of the compressed trace over the same time as GRID


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """The echo of a reference block, at delay 0, in the band of the probe."""

    probe: ProbeModel
    excitation: Excitation
    bins: np.typing.NDArray[np.int64]  # (f,) of a transform over GRID samples
    frequencies_mhz: Floats  # (f,)
    spectrum: Complexes  # (f,) of an ideal mirror
    weights: Floats  # (f,) what matched filters count a frequency for
    carrier_bin: int
    noise: float = 0.0  # rms in each trace sample that the weights were made for

    @property
    def carrier_mhz(self) -> float:
        """Frequency that compressed traces are mixed down with."""
        return self.carrier_bin * self.probe.sampling_mhz / GRID

    @property
    def step_us(self) -> float:
        """Time between samples of a compressed trace."""
        return GRID / COMPRESSED / self.probe.sampling_mhz

    def shift(self, delays_us: Floats) -> Complexes:
        """Return the factors (n, f) that bring what happens at ``delays_us`` (n,) to time 0."""
        f = self.frequencies_mhz
        turns = 2j * np.pi * np.asarray(delays_us, dtype=np.float64)[:, None]
        # frequencies are evenly spaced: those of every 16th, times those of the 16 from there on
        coarse, fine = np.exp(turns * f[::EVERY]), np.exp(turns * (f[:EVERY] - f[0]))
        factors = coarse[:, :, None] * fine[:, None, :]
        return factors.reshape(len(turns), coarse.shape[1] * fine.shape[1])[:, : len(f)]

    def weighed_for(self, echo: Complexes) -> "Template":
        """Return the template with weights for an echo (f,): noise above it ends equalising."""
        power = np.abs(self.spectrum) ** 2
        lost = float(power.max() / max((np.abs(echo) ** 2).max(), 1e-30))
        return replace(
            self, weights=equal_weights(self.probe, self.frequencies_mhz, power, self.noise, lost)
        )

    def matched(self, echo: Complexes) -> Complexes:
        """Return the matched filter (f,) whose output is 1 at the time of an echo (f,)."""
        energy = np.sum(self.weights * np.abs(echo) ** 2)
        return np.asarray(self.weights * np.conj(echo) / energy, dtype=np.complex128)

    def filtered(self, spectra: Complexes, echo: Complexes, lags_us: Floats) -> Complexes:
        """Return matched-filter outputs (n, lags) of spectra (n, f) for an echo (f,)."""
        return spectra @ (self.matched(echo) * self.shift(lags_us)).T

    def compress(self, spectra: Complexes, template: Complexes) -> Complexes:
        """Return matched-filter outputs (..., COMPRESSED), mixed down, 1 where the template is."""
        product = spectra * self.matched(template)
        baseband = np.zeros((*product.shape[:-1], COMPRESSED), dtype=np.complex128)
        baseband[..., (self.bins - self.carrier_bin) % COMPRESSED] = product
        return np.fft.ifft(baseband, axis=-1) * COMPRESSED

    def noise_gain(self, template: Complexes) -> float:
        """Return the rms of the compressed trace for noise of rms 1 in each trace sample."""
        power = np.abs(template) ** 2
        energy = np.sum(self.weights * power)
        return float(np.sqrt(GRID * np.sum(self.weights**2 * power)) / energy)


@lru_cache(maxsize=16)
def block_template(probe: ProbeModel, excitation: Excitation, noise: float = 0.0) -> Template:
    """Return the template of a probe and excitation; amplitudes are relative to this mirror.

    Args:
        probe: The probe.
        excitation: What it sends.
        noise: RMS in each trace sample; equalising stops earlier where there is more of it.
    """
    f = grid_frequencies_mhz(probe)
    bins = np.flatnonzero(in_band(probe, f))
    echo = emission_spectrum(probe, excitation) * mirror_spectrum(probe)
    # the receiver's gain makes flat bone in perfect contact peak at a known share of full scale
    echo *= FULL_SCALE_SHARE / BONE_REFLECTION / np.abs(np.fft.irfft(echo, GRID)).max()
    spectrum = echo[bins]
    power = np.abs(spectrum) ** 2
    weights = equal_weights(probe, f[bins], power, noise)
    carrier = round(probe.centre_mhz * GRID / probe.sampling_mhz)
    return Template(
        probe,
        excitation,
        readonly(bins),
        readonly(f[bins]),
        readonly(spectrum),
        readonly(weights),
        carrier,
        noise,
    )


def equal_weights(
    probe: ProbeModel, frequencies_mhz: Floats, power: Floats, noise: float, lost: float = 1.0
) -> Floats:
    """Return what a matched filter counts frequencies (f,) for.

    Args:
        probe: The probe.
        frequencies_mhz: In its band (f,).
        power: Of the template (f,).
        noise: RMS in each trace sample.
        lost: Peak power of the template over that of the echo that is sought.
    """
    off = (frequencies_mhz / probe.centre_mhz - 1.0) / EQUAL_BAND
    target = np.exp(-4.0 * np.log(2.0) * off**2)
    noisy = NOISE_FLOOR * GRID * noise**2 * lost / power.max()
    flat = (power / power.max() + PROBE_DATA[probe.name].equal_floor) / target
    weights: Floats = 1.0 / (flat + noisy)
    return weights


def trace_spectra(rf: Floats, start_us: float, template: Template) -> tuple[Complexes, Floats]:
    """Return in-band spectra (n, f) with time from the emission on, and noise rms (n,).

    The noise is read off the frequencies above the probe's band, where it is all there is.
    """
    f = grid_frequencies_mhz(template.probe)
    quiet = (f > 2.5 * template.probe.centre_mhz) & (f < 0.45 * template.probe.sampling_mhz)
    delay = np.exp(-2j * np.pi * template.frequencies_mhz * start_us)
    spectra, noise = np.zeros((len(rf), len(delay)), dtype=np.complex128), np.zeros(len(rf))
    for start in range(0, len(rf), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        full = np.fft.rfft(rf[some], GRID, axis=1)
        power = full.real[:, quiet] ** 2 + full.imag[:, quiet] ** 2
        noise[some] = np.sqrt(row_medians(power) / np.log(2.0) / rf.shape[1])  # exponential law
        spectra[some] = full[:, template.bins] * delay
    return spectra, noise


def row_medians(values: Floats) -> Floats:
    """Return the medians (n,) of rows (n, m) of finite numbers, faster than numpy for any."""
    middle = values.shape[1] // 2
    ranked = np.partition(values, middle, axis=1)
    upper = ranked[:, middle]
    return upper if values.shape[1] % 2 else 0.5 * (ranked[:, :middle].max(axis=1) + upper)


def quiet_template(
    probe: ProbeModel, excitation: Excitation, rf: Floats | NDArray[np.float32]
) -> Template:
    """Return the template for the noise of a survey (n, samples); equal noise gives the same."""
    some = rf[:: max(1, len(rf) // NOISE_SCANS)].astype(np.float64)
    if not len(some):
        return block_template(probe, excitation)
    noise = float(np.median(trace_spectra(some, 0.0, block_template(probe, excitation))[1]))
    steps = np.rint(np.log2(np.clip(noise, 1e-9, 1.0)) * NOISE_STEPS) / NOISE_STEPS
    return block_template(probe, excitation, float(2.0**steps))


def peak_offsets(levels: Floats, at: np.typing.NDArray[np.int64]) -> Floats:
    """Return by how many samples (n,) a parabola moves the maxima ``at`` (n,) of rows (n, m)."""
    rows = np.arange(len(levels))
    inside = np.clip(at, 1, levels.shape[1] - 2)
    before, middle, after = (levels[rows, inside + i] for i in (-1, 0, 1))
    bend = before - 2.0 * middle + after
    offset = np.divide(0.5 * (before - after), bend, out=np.zeros(len(at)), where=bend < 0)
    return np.asarray(np.clip(offset, -0.5, 0.5) + (inside - at), dtype=np.float64)


def rows_of(record: Record, rows: slice) -> Record:
    """Return a record of arrays with these rows of each."""
    return replace(record, **{f.name: getattr(record, f.name)[rows] for f in fields(record)})


def joined(parts: Sequence[Record]) -> Record:
    """Return records of arrays as one with the rows of all; what all of them share stays."""
    first: Any = parts[0]
    if isinstance(first, np.ndarray):
        whole: Any = np.concatenate(parts)
        return whole
    if all(part is first for part in parts):
        return first
    names = [f.name for f in fields(first)]
    return replace(first, **{name: joined([getattr(p, name) for p in parts]) for name in names})
