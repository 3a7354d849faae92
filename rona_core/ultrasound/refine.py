"""The time of a chosen inner echo: envelope and phase weighed against each other, with its sigma.

The front echo is fitted again without the inner one, whose time is then fitted with weights that
make the remaining noise and clutter white. The phase is ten times as sharp as the envelope, but
it repeats: the cycles that may be meant are weighed by how far they are from the envelope's peak,
and what comes out is the mean. So there are no slips, only a sigma that grows where one could be.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.arrays import Floats
from rona_core.ultrasound.crlb import Fisher, amplitude_bound
from rona_core.ultrasound.front import subtract_fronts
from rona_core.ultrasound.inner import bone_filter
from rona_core.ultrasound.matched import Template
from rona_core.ultrasound.material import Complexes, Material
from rona_core.ultrasound.pulse import GRID

ROUNDS = 2  # of fitting the front without the inner echo and the other way round
STEPS = 3  # of Gauss and Newton in each
FARTHEST = 0.5  # over the bandwidth: a fit does not leave its peak further than this
CYCLES = np.arange(-2.0, 3.0)  # that the phase may be off by
ENVELOPE_SD = 0.035  # over the bandwidth: of the envelope by structure, at a level of 1
PHASE_SD_RAD = 0.08  # of the phase by structure, at a level of 1
STRUCTURE_RAD = 0.14  # what sigma gets besides: the boundary is not the same over the beam
FADING = 1.0  # both grow with one over the level to this power
LEAST_LEVEL = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class InnerTimes:
    """Times of inner echoes (n,) after their fronts, and how well they are known."""

    lag_us: Floats
    sigma_us: Floats
    noise_us: Floats  # the share of it that is the bound for noise and clutter


def refine_inner(
    aligned: Complexes,
    noise: Floats,
    lag_us: Floats,
    level: Floats,
    clutter: Floats,
    template: Template,
    bone: Material,
) -> InnerTimes:
    """Return the times of inner echoes in spectra (n, f) that are aligned to their fronts.

    Args:
        aligned: With the front echo at time 0.
        noise: RMS of the noise in each sample (n,).
        lag_us: Where the envelope has its peak (n,).
        level: Height of the peak over a nominal echo (n,).
        clutter: RMS of the clutter on that scale (n,), behind the equalised filter.
        template: Of probe and excitation.
        bone: Nominal bone.
    """
    f = template.frequencies_mhz
    echo = bone_filter(template, bone, lag_us * bone.speed_mm_per_us / 2.0)
    weights = _whitening(echo, noise, clutter, template)
    fisher = Fisher.of(echo, weights, f)
    omega = 2.0 * np.pi * f
    matched = weights * np.conj(echo)
    band = template.probe.bandwidth * template.probe.centre_mhz
    start, at = lag_us, lag_us
    height = np.zeros(len(lag_us), dtype=np.complex128)
    behind = subtract_fronts(aligned, template)
    for turn in range(ROUNDS + 1):
        if turn:
            own = height[:, None] * echo * np.conj(template.shift(at))
            behind = own + subtract_fronts(aligned - own, template)
        for _ in range(STEPS):
            seen = matched * behind * template.shift(at)
            z = seen.sum(axis=1)
            height = z / fisher.energy
            slope = (seen * (omega - fisher.mean_rad_per_us[:, None])).sum(axis=1)
            move = np.real(1j * np.conj(height) * slope)
            at = at + move / np.maximum(np.abs(height) ** 2 * fisher.envelope, 1e-30)
            at = np.clip(at, start - FARTHEST / band, start + FARTHEST / band)
    seen = (matched * behind * template.shift(at)).sum(axis=1)
    amplitude = np.abs(seen) / fisher.energy
    coherent = at - np.angle(seen) / fisher.mean_rad_per_us
    for _ in range(STEPS - 1):
        seen = matched * behind * template.shift(coherent)
        height = np.maximum(np.real(seen.sum(axis=1)), 1e-12) / fisher.energy
        move = np.real(1j * (seen * omega).sum(axis=1)) / (height * fisher.coherent)
        coherent = coherent + np.clip(move, -0.1 / band, 0.1 / band)
    return _weighed(at, coherent, amplitude, level, fisher, band)


def _whitening(echo: Complexes, noise: Floats, clutter: Floats, template: Template) -> Floats:
    """Return one over the power (n, f) of noise and clutter in the spectra."""
    power = np.abs(echo) ** 2
    matched = template.weights * power
    share = matched.sum(axis=1) ** 2 / (matched**2).sum(axis=1)
    density = GRID * np.maximum(noise, 1e-9)[:, None] ** 2
    return 1.0 / (density + (clutter**2 * share)[:, None] * power)


def _weighed(
    envelope: Floats,
    coherent: Floats,
    amplitude: Floats,
    level: Floats,
    fisher: Fisher,
    band: float,
) -> InnerTimes:
    """Return the mean over the cycles that the phase may mean."""
    sharp, blunt = amplitude_bound(fisher, amplitude)
    fading = np.clip(level, LEAST_LEVEL, 1.0) ** -FADING
    phase_us = PHASE_SD_RAD * fading / fisher.mean_rad_per_us
    fine = sharp**2 + phase_us**2
    coarse = blunt**2 + (ENVELOPE_SD * fading / band) ** 2
    period = 2.0 * np.pi / fisher.mean_rad_per_us
    off = (coherent - envelope)[:, None] + CYCLES * period[:, None]
    chance = np.exp(
        -0.5 * (off**2 - (off**2).min(axis=1, keepdims=True)) / (fine + coarse)[:, None]
    )
    chance /= chance.sum(axis=1, keepdims=True)
    means = off * (coarse / (fine + coarse))[:, None]
    mean = (chance * means).sum(axis=1)
    spread = (chance * (means - mean[:, None]) ** 2).sum(axis=1)
    structure = STRUCTURE_RAD * fading / fisher.mean_rad_per_us
    sigma = np.sqrt(spread + fine * coarse / (fine + coarse) + structure**2)
    return InnerTimes(envelope + mean, sigma, np.minimum(sharp, sigma))
