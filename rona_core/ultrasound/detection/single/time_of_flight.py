"""The time of a chosen inner echo: envelope and phase weighed against each other, with its sigma.

It is fitted together with its front and with the echo that follows it: first its envelope, with
weights that make noise and clutter white, then its phase in noise alone. The phase is ten times as
sharp as the envelope, but it repeats: the cycles that may be meant are weighed by how far they are
from the envelope's peak, and what comes out is the mean. So there are no slips, only a sigma that
grows where one could be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.single.cramer_rao import Fisher, amplitude_bound
from rona_core.ultrasound.detection.single.front_echo import Fronts, subtract_fronts
from rona_core.ultrasound.detection.single.front_echo_fit import (
    Rest,
    front_shapes,
    front_times,
    products,
    without_gap,
)
from rona_core.ultrasound.detection.single.inner_echo import INNER_OVER_FRONT, bone_filter
from rona_core.ultrasound.detection.single.matched_filter import BONE_REFLECTION, Template
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
# height of the inner echo that comes again over that of the first, without loss
AGAIN = -INNER_OVER_FRONT * BONE_REFLECTION**2 / (1.0 - BONE_REFLECTION**2)


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
    fronts: Fronts,
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
        fronts: Those front echoes (n,).
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
    band = template.probe.bandwidth * template.probe.centre_mhz
    shapes, density = front_shapes(template), _density(noise)
    aligned = without_gap(aligned, fronts, template)
    near = subtract_fronts(aligned, template)
    at = lag_us
    height = np.zeros(len(lag_us), dtype=np.complex128)
    for _ in range(STEPS):
        here = echo * np.conj(template.shift(at))
        slope = -1j * omega * here
        here_left, slope_left = (subtract_fronts(x, template) for x in (here, slope))
        own = np.real(products(here_left, weights * here_left))
        cross = products(here_left, weights * slope_left) / own
        seen = weights * near
        height = products(here_left, seen) / own
        steep = np.real(products(slope_left, weights * slope_left)) - np.abs(cross) ** 2 * own
        move = products(slope_left, seen) - np.conj(cross) * height * own
        move = np.real(np.conj(height) * move) / np.maximum(np.abs(height) ** 2 * steep, 1e-30)
        at = np.clip(at + move, lag_us - FARTHEST / band, lag_us + FARTHEST / band)
    amplitude = np.abs(height)
    phase = at - np.angle(height) / fisher.mean_rad_per_us
    again = bone_filter(template, bone, lag_us * bone.speed_mm_per_us)
    again = AGAIN * again * np.conj(template.shift(2.0 * at))
    rest = Rest(shapes, density, again, amplitude)
    phase, inner = _fit_phase(aligned, echo, phase, rest, template)
    front = np.where(fronts.heard, front_times(aligned - inner, template), 0.0)
    front = np.clip(front, -MOST_MOVE / band, MOST_MOVE / band)
    sharp, blunt = amplitude_bound(fisher, amplitude)
    fading = np.clip(level, LEAST_LEVEL, 1.0) ** -FADING
    return InnerFits(
        envelope_us=at - front,
        envelope_sd_us=np.hypot(blunt, ENVELOPE_SD * fading / band),
        phase_us=phase - front,
        period_us=2.0 * np.pi / fisher.mean_rad_per_us,
        phase_sd_us=np.hypot(sharp, PHASE_SD_RAD * fading / fisher.mean_rad_per_us),
        structure_us=STRUCTURE_RAD * fading / fisher.mean_rad_per_us,
        noise_us=sharp,
    )


def _fit_phase(
    aligned: Complexes, echo: Complexes, start_us: Floats, rest: Rest, template: Template
) -> tuple[Floats, Complexes]:
    """Return times (n,) and echoes (n, f), fitted jointly with all else in white noise.

    Height and time are the two unknowns of each echo; what else may be there is out of the spectra
    ``aligned`` (n, f), and out of what the echo and its slope would look like.
    """
    omega = 2.0 * np.pi * template.frequencies_mhz
    most = MOST_MOVE / (template.probe.bandwidth * template.probe.centre_mhz)
    clear = rest.of(aligned)
    at = start_us
    height = np.zeros(len(at))
    for _ in range(PHASE_STEPS):
        here = echo * np.conj(template.shift(at))
        slope = -1j * omega * here
        here_left = rest.of(here)
        own, cross = products(here, here_left).real, products(slope, here_left).real
        steep = products(slope, rest.of(slope)).real
        seen, seen_steep = products(here, clear).real, products(slope, clear).real
        whole = np.maximum(own * steep - cross**2, 1e-30)
        height = np.maximum((steep * seen - cross * seen_steep) / whole, 1e-12)
        move = (own * seen_steep - cross * seen) / whole / height
        at = at + np.clip(move, -most, most)
    return at, height[:, None] * echo * np.conj(template.shift(at))


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
