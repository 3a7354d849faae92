"""Time of flight of a selected inner echo from envelope and phase, with its sigma.

It is fitted together with its front: first its envelope, with
weights that make noise and clutter white, then its phase in noise alone. The phase is ten times as
sharp as the envelope, but it repeats: the cycles that may be meant are weighed by how far they are
from the envelope's peak, and what comes out is the mean. So there are no slips, only a sigma that
grows where one could be.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.single.front_echo import (
    Fronts,
    front_times,
    products,
    subtract_fronts,
    without_gap,
)
from rona_core.ultrasound.detection.single.inner_echo import bone_filter
from rona_core.ultrasound.detection.single.matched_filter import Template
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.materials import Complexes, Material

STEPS = 6  # of Gauss and Newton on envelope,
PHASE_STEPS = 3  # and then on phase
MOST_MOVE = 0.1  # over the bandwidth: of a time in one step on its phase
FARTHEST = 0.25  # over the bandwidth: a fit does not leave its peak further than this
CYCLES = np.arange(-2.0, 3.0)  # that the phase may be off by
ENVELOPE_SD = 0.07  # over the bandwidth: of the envelope by structure, at a level of 1
PHASE_SD_RAD = 0.08  # of the phase by structure, at a level of 1
STRUCTURE_RAD = 0.14  # what sigma gets besides: the boundary is not the same over the beam
FADING = 1.0  # both grow with one over the level to this power
LEAST_LEVEL = 0.1


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


@dataclass(frozen=True, slots=True, eq=False)
class InnerFits:
    """Inner echoes (n,) after their fronts, fitted by envelope and by phase."""

    envelope_us: Floats
    envelope_sd_us: Floats
    phase_us: Floats  # one of the times that the phase may mean,
    period_us: Floats  # and how far apart they are
    phase_sd_us: Floats
    structure_us: Floats  # what sigma gets besides
    noise_us: Floats  # the bound for noise alone


@dataclass(frozen=True, slots=True, eq=False)
class EnvelopePeaks:
    """Peaks (n,) of the envelope that are taken for the inner echoes."""

    lag_us: Floats  # after the front echo
    level: Floats  # over a nominal echo
    clutter: Floats  # rms on that scale, behind the equalised filter


def fit_inner(
    aligned: Complexes,
    fronts: Fronts,
    noise: Floats,
    peaks: EnvelopePeaks,
    template: Template,
    bone: Material,
) -> InnerFits:
    """Fit inner echoes in spectra (n, f) that are aligned to their fronts.

    The model of a spectrum behind the front is h S(f) exp(-j w t): complex height h, nominal echo
    S, time t (Demirli 2001).

    Args:
        aligned: With the front echo at time 0.
        fronts: Those front echoes (n,).
        noise: RMS of the noise in each sample (n,).
        peaks: Where the envelopes have their peaks (n,).
        template: Of probe and excitation.
        bone: Nominal bone.
    """
    lag_us, f = peaks.lag_us, template.frequencies_mhz
    echo = bone_filter(template, bone, lag_us * bone.speed_mm_per_us / 2.0)
    weights = _whitening(echo, noise, peaks.clutter, template)
    fisher = Fisher.of(echo, weights, f)
    band = template.probe.bandwidth * template.probe.centre_mhz
    aligned = without_gap(aligned, fronts, template)
    time, height = _fit_envelope(aligned, echo, weights, lag_us, template)
    amplitude = np.abs(height)
    phase = time - np.angle(height) / fisher.mean_rad_per_us
    phase, inner = _fit_phase(aligned, echo, phase, template)
    front = np.where(fronts.measured, front_times(aligned - inner, template), 0.0)
    front = np.clip(front, -MOST_MOVE / band, MOST_MOVE / band)
    coherent_sd, envelope_sd = amplitude_bound(fisher, amplitude)
    fading = np.clip(peaks.level, LEAST_LEVEL, 1.0) ** -FADING
    return InnerFits(
        envelope_us=time - front,
        envelope_sd_us=np.hypot(envelope_sd, ENVELOPE_SD * fading / band),
        phase_us=phase - front,
        period_us=2.0 * np.pi / fisher.mean_rad_per_us,
        phase_sd_us=np.hypot(coherent_sd, PHASE_SD_RAD * fading / fisher.mean_rad_per_us),
        structure_us=STRUCTURE_RAD * fading / fisher.mean_rad_per_us,
        noise_us=coherent_sd,
    )


def _fit_envelope(
    aligned: Complexes, echo: Complexes, weights: Floats, start_us: Floats, template: Template
) -> tuple[Floats, Complexes]:
    """Return times (n,) and complex heights (n,): weighted Gauss-Newton, phase left free.

    With s the echo at time t and d = ds/dt, the height that fits best is h = <s, x> / <s, s>, and
    d off s, d - c s with c = <s, d> / <s, s>, gives the step in time.
    """
    omega = 2.0 * np.pi * template.frequencies_mhz
    reach = FARTHEST / (template.probe.bandwidth * template.probe.centre_mhz)
    white = np.sqrt(weights)
    x = white * subtract_fronts(aligned, template)
    time = start_us
    height = np.zeros(len(start_us), dtype=np.complex128)
    for _ in range(STEPS):
        s = echo * template.shift(-time)
        s, d = (white * subtract_fronts(part, template) for part in (s, -1j * omega * s))
        s_s = np.real(products(s, s))
        c = products(s, d) / s_s
        height = products(s, x) / s_s
        curvature = np.real(products(d, d)) - np.abs(c) ** 2 * s_s
        gradient = products(d, x) - np.conj(c) * height * s_s
        step = np.real(np.conj(height) * gradient)
        step = step / np.maximum(np.abs(height) ** 2 * curvature, 1e-30)
        time = np.clip(time + step, start_us - reach, start_us + reach)
    return time, height


def _fit_phase(
    aligned: Complexes, echo: Complexes, start_us: Floats, template: Template
) -> tuple[Floats, Complexes]:
    """Return times (n,) and echoes (n, f), fitted jointly with the front in white noise.

    Real height h and time t are the two unknowns of each echo, with s and d = ds/dt as in the
    envelope's fit. The front is subtracted from the spectra ``aligned`` (n, f), from s and from d;
    the normal equations of x = h s + h dt d are solved in closed form.
    """
    omega = 2.0 * np.pi * template.frequencies_mhz
    most = MOST_MOVE / (template.probe.bandwidth * template.probe.centre_mhz)
    x = subtract_fronts(aligned, template)
    time = start_us
    height = np.zeros(len(time))
    for _ in range(PHASE_STEPS):
        s = echo * template.shift(-time)
        d = -1j * omega * s
        s_left = subtract_fronts(s, template)
        s_s, d_s = products(s, s_left).real, products(d, s_left).real
        d_d = products(d, subtract_fronts(d, template)).real
        s_x, d_x = products(s, x).real, products(d, x).real
        determinant = np.maximum(s_s * d_d - d_s**2, 1e-30)
        height = np.maximum((d_d * s_x - d_s * d_x) / determinant, 1e-12)
        step = (s_s * d_x - d_s * s_x) / determinant / height
        time = time + np.clip(step, -most, most)
    return time, height[:, None] * echo * template.shift(-time)


def _density(noise: Floats) -> Floats:
    """Return the power (n,) of white noise in each bin of the spectra."""
    return GRID * np.maximum(noise, 1e-9) ** 2


def _whitening(echo: Complexes, noise: Floats, clutter: Floats, template: Template) -> Floats:
    """Return one over the power (n, f) of noise and clutter in the spectra."""
    power = np.abs(echo) ** 2
    matched = template.weights * power
    share = matched.sum(axis=1) ** 2 / (matched**2).sum(axis=1)
    return 1.0 / (_density(noise)[:, None] + (clutter**2 * share)[:, None] * power)


def choose_cycles(
    fits: InnerFits, expected_us: Floats | None = None, expected_sd_us: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return the times (n,) of inner echoes as means over the cycles they may mean, and sigmas.

    Args:
        fits: What the A-scans show.
        expected_us: What the neighbours predict (n,); None: nothing.
        expected_sd_us: And how far off that may be (n,), infinite where it is nothing.
    """
    off = (fits.phase_us - fits.envelope_us)[:, None] + CYCLES * fits.period_us[:, None]
    squares = off**2 / (fits.phase_sd_us**2 + fits.envelope_sd_us**2)[:, None]
    if expected_us is not None and expected_sd_us is not None:
        beside = off + (fits.envelope_us - expected_us)[:, None]
        squares = squares + beside**2 / (fits.phase_sd_us**2 + expected_sd_us**2)[:, None]
    chance = np.exp(-0.5 * (squares - squares.min(axis=1, keepdims=True)))
    chance /= chance.sum(axis=1, keepdims=True)
    mean = (chance * off).sum(axis=1)
    spread = (chance * (off - mean[:, None]) ** 2).sum(axis=1)
    sigma = np.sqrt(spread + fits.phase_sd_us**2 + fits.structure_us**2)
    return fits.envelope_us + mean, sigma
