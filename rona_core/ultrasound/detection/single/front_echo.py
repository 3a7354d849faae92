"""Detection and subtraction of the front echo, which shows the outer boundary and the contact.

What comes back from the outer boundary is 20 to 30 dB above the echo of the inner one, and the
side lobes of a compressed chirp are only 20 dB below their peak: without subtracting the front
echo the largest later peak is usually one of its own.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.ultrasound.detection.single.matched_filter import (
    BONE_REFLECTION,
    GEL_MRAYL,
    Template,
    peak_offsets,
)
from rona_core.ultrasound.probe.materials import GEL, Complexes
from rona_core.ultrasound.probe.probe_model import ProbeModel

GATE_MARGIN_MM = 0.3  # the front is sought this far beyond the compliance of the line
TAPS = 9
TAP_SPACING = 0.12  # over the -6 dB bandwidth
FIT_HALF_WIDTH = 1.0  # of the fit, over the bandwidth
RIDGE = 1e-3
FRONT_SNR = 8.0  # below it there is no front echo
EDGE_US = 0.1  # so close to the ends of the gate it is none either
MOST_LEVEL = 1.2  # a louder front is not the template's


@dataclass(frozen=True, slots=True, eq=False)
class Fronts:
    """The front echo of each A-scan (n,)."""

    delay_us: Floats  # after the echo of a block on the face of the line
    level: Floats  # amplitude over that of flat bone in perfect contact
    snr: Floats  # amplitude over the rms of the compressed noise
    positive: Bools  # False: reflected by something softer than gel, that is, air

    @property
    def measured(self) -> Bools:
        """Which fronts were measured, and not known from elsewhere."""
        return np.asarray(np.isfinite(self.snr))


def gate_us(probe: ProbeModel) -> tuple[float, float]:
    """Return the earliest and the latest delay at which the front may come."""
    reach = probe.compliance_mm + GATE_MARGIN_MM
    return -2.0 * reach / probe.line.speed_mm_per_us, 2.0 * reach / GEL.speed_mm_per_us


def find_fronts(spectra: Complexes, noise: Floats, template: Template) -> Fronts:
    """Return the largest echo within reach of the line, timed to a fraction of a cycle."""
    early, late = gate_us(template.probe)
    first, step = template.probe.line_delay_us + early, template.step_us
    lags = first + step * np.arange(int((late - early) / step) + 1, dtype=np.float64)
    z = template.filtered(spectra, template.spectrum, lags)
    level = np.abs(z)
    at = np.argmax(level, axis=1)
    rows = np.arange(len(z))
    samples = at + peak_offsets(level, at)
    delay = early + samples * step
    # phase at the sample, carried on to the interpolated peak
    onward = 2.0 * np.pi * template.carrier_mhz * (samples - at) * step
    phase = np.angle(z[rows, at] * np.exp(1j * onward))
    positive = np.abs(phase) < 0.6 * np.pi
    delay = np.where(positive, delay - phase / (2.0 * np.pi * template.carrier_mhz), delay)
    peak = level[rows, at]
    rms = noise * template.noise_gain(template.spectrum)
    return Fronts(
        delay, peak / BONE_REFLECTION, peak / np.maximum(rms, 1e-12), np.asarray(positive)
    )


def fronts_found(fronts: Fronts, probe: ProbeModel) -> Bools:
    """Return which of the largest echoes within reach (n,) are front echoes of bone."""
    early, late = gate_us(probe)
    edge = (fronts.delay_us < early + EDGE_US) | (fronts.delay_us > late - EDGE_US)
    return np.asarray((fronts.snr >= FRONT_SNR) & fronts.positive & ~edge)


def standoff_mm(delay_us: Floats, probe: ProbeModel) -> Floats:
    """Return the distance (n,) from the face of the uncompressed line to the bone.

    The line is pressed or a gap is filled with gel; a film of gel is always there.
    """
    film, line, gel = probe.film_mm, probe.line.speed_mm_per_us, GEL.speed_mm_per_us
    at_film = 2.0 * film / gel
    pressed = film + (delay_us - at_film) / 2.0 * line
    gap = film + (delay_us - at_film) / 2.0 * gel
    return np.where(delay_us < at_film, pressed, gap)


def fronts_at(standoffs_mm: Floats, probe: ProbeModel) -> Fronts:
    """Return fronts at known distances (n,) from the face of the uncompressed line."""
    film, line, gel = probe.film_mm, probe.line.speed_mm_per_us, GEL.speed_mm_per_us
    beyond = standoffs_mm - film
    delay = 2.0 * film / gel + 2.0 * beyond / np.where(beyond < 0.0, line, gel)
    level = np.ones(len(standoffs_mm))
    return Fronts(delay, level, np.full(len(level), np.inf), np.asarray(level > 0.0))


def subtract_fronts(aligned: Complexes, template: Template) -> Complexes:
    """Return spectra (n, f) without their front echo, which must be aligned to time 0.

    The echo is fitted near its peak by a few delayed copies of the template, which absorb tilt,
    curvature and film; the fit takes its side lobes away far beyond the place of the fit.
    """
    found, copies = _near_fit(template)
    left = (aligned @ found) @ copies
    return np.subtract(aligned, left, out=left)


@lru_cache(maxsize=16)
def _near_fit(template: Template) -> tuple[Complexes, Complexes]:
    """Return what gives the heights of the copies (f, k), and the copies (k, f)."""
    band = template.probe.bandwidth * template.probe.centre_mhz
    delays = (np.arange(TAPS, dtype=np.float64) - TAPS // 2) * TAP_SPACING / band
    copies = template.spectrum * np.conj(template.shift(delays))
    reach = int(FIT_HALF_WIDTH / band / template.step_us)
    near = np.arange(-reach, reach + 1)
    basis = template.compress(copies, template.spectrum)[:, near].T
    normal = basis.conj().T @ basis
    normal += RIDGE * np.trace(normal).real / TAPS * np.eye(TAPS)
    every = np.eye(len(template.frequencies_mhz), dtype=np.complex128)
    seen = template.compress(every, template.spectrum)[:, near].T
    found = np.asarray(np.linalg.solve(normal, basis.conj().T @ seen).T, dtype=np.complex128)
    return readonly(found), readonly(copies)


def without_gap(aligned: Complexes, fronts: Fronts, template: Template) -> Complexes:
    """Return aligned spectra (n, f) as they are when line and gel are of one impedance.

    They are nearly, but what the face of the line returns comes before the front echo by the way
    through the gel, and again behind it and behind the inner echo: a hundredth of the front, enough
    to move times by a nanosecond, and by another one at each distance.
    """
    line = template.probe.line.speed_mm_per_us * template.probe.line.density_g_per_cm3
    face = (GEL_MRAYL - line) / (GEL_MRAYL + line)
    gap_mm = np.maximum(standoff_mm(fronts.delay_us, template.probe), template.probe.film_mm)
    early = template.shift(2.0 * gap_mm / GEL.speed_mm_per_us)
    late = np.conj(early)
    level = np.where(fronts.measured & fronts.positive, np.minimum(fronts.level, MOST_LEVEL), 0.0)
    beside = (early + BONE_REFLECTION**2 * late) * template.spectrum
    clear = aligned * (1.0 + face * BONE_REFLECTION * late) ** 2
    return clear - (face * level)[:, None] * beside


def front_times(fronts: Complexes, template: Template) -> Floats:
    """Return the times (n,) of front echoes (n, f) near time 0, with weights for noise alone."""
    omega = 2.0 * np.pi * template.frequencies_mhz
    power = np.abs(template.spectrum) ** 2
    height = np.real(fronts @ np.conj(template.spectrum)) / power.sum()
    slope = -np.imag(fronts @ (omega * np.conj(template.spectrum))) / (power @ omega**2)
    return slope / np.maximum(height, 1e-12)


def products(a: Complexes, b: Complexes) -> Complexes:
    """Return the inner products (n,) of spectra (n, f)."""
    return np.asarray(np.vecdot(a, b), dtype=np.complex128)
