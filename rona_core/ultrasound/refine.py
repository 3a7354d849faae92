"""The time of a chosen inner echo: envelope and phase weighed against each other, with its sigma.

The front echo is fitted again without the inner one, whose time is then fitted with weights that
make the remaining noise and clutter white. The phase is ten times as sharp as the envelope, but
it repeats: the cycles that may be meant are weighed by how far they are from the envelope's peak,
and what comes out is the mean. So there are no slips, only a sigma that grows where one could be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

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
FARTHEST = 0.25  # over the bandwidth: a fit does not leave its peak further than this
CYCLES = np.arange(-2.0, 3.0)  # that the phase may be off by
ENVELOPE_SD = 0.07  # over the bandwidth: of the envelope by structure, at a level of 1
PHASE_SD_RAD = 0.08  # of the phase by structure, at a level of 1
STRUCTURE_RAD = 0.14  # what sigma gets besides: the boundary is not the same over the beam
FADING = 1.0  # both grow with one over the level to this power
LEAST_LEVEL = 0.1


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

    @classmethod
    def concatenate(cls, parts: Sequence["InnerFits"]) -> "InnerFits":
        """Return the fits of several blocks as one."""
        return cls(
            *(
                np.concatenate([np.zeros(0), *(getattr(part, f.name) for part in parts)])
                for f in fields(cls)
            )
        )


def fit_inner(
    aligned: Complexes,
    noise: Floats,
    lag_us: Floats,
    level: Floats,
    clutter: Floats,
    template: Template,
    bone: Material,
) -> InnerFits:
    """Fit inner echoes in spectra (n, f) that are aligned to their fronts.

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
    phase = at - np.angle(seen) / fisher.mean_rad_per_us
    for shape in (weights, np.ones(len(f)), np.ones(len(f))):  # noise alone, once near
        seen = shape * np.conj(echo) * behind * template.shift(phase)
        power = shape * np.abs(echo) ** 2
        bend = (power * omega**2).sum(axis=1) / power.sum(axis=1)
        scale = np.maximum(np.real(seen.sum(axis=1)), 1e-12)
        move = np.real(1j * (seen * omega).sum(axis=1)) / (scale * bend)
        phase = phase + np.clip(move, -0.1 / band, 0.1 / band)
    sharp, blunt = amplitude_bound(fisher, amplitude)
    fading = np.clip(level, LEAST_LEVEL, 1.0) ** -FADING
    return InnerFits(
        envelope_us=at,
        envelope_sd_us=np.hypot(blunt, ENVELOPE_SD * fading / band),
        phase_us=phase,
        period_us=2.0 * np.pi / fisher.mean_rad_per_us,
        phase_sd_us=np.hypot(sharp, PHASE_SD_RAD * fading / fisher.mean_rad_per_us),
        structure_us=STRUCTURE_RAD * fading / fisher.mean_rad_per_us,
        noise_us=sharp,
    )


def _whitening(echo: Complexes, noise: Floats, clutter: Floats, template: Template) -> Floats:
    """Return one over the power (n, f) of noise and clutter in the spectra."""
    power = np.abs(echo) ** 2
    matched = template.weights * power
    share = matched.sum(axis=1) ** 2 / (matched**2).sum(axis=1)
    density = GRID * np.maximum(noise, 1e-9)[:, None] ** 2
    return 1.0 / (density + (clutter**2 * share)[:, None] * power)


def choose_cycles(
    fits: InnerFits, expected_us: Floats | None = None, expected_sd_us: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return the times (n,) of inner echoes as means over the cycles they may mean, and sigmas.

    Args:
        fits: What the A-scans show.
        expected_us: What those around make one expect (n,); None: nothing.
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
