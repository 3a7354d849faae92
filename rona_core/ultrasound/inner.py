"""Candidates for the inner echo: peaks of what is left behind the front echo.

The search uses the envelope, since the phase of a broadband echo repeats every cycle; the sign,
opposite to the front echo's, is evidence, and the phase refines the time of what was chosen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rona_core.arrays import Bools, Floats
from rona_core.ultrasound.matched import BONE_REFLECTION, Template, peak_offsets
from rona_core.ultrasound.material import BRAIN, TABLE, Complexes, Material
from rona_core.ultrasound.probe import ProbeModel

CANDIDATES = 6  # kept for each A-scan
BANK_STEP_MM = 2.0  # thickness between templates
GATE_MARGIN_MM = 0.6  # sought beyond the range, so that a peak at its end is one
BRAIN_MRAYL, BONE_MRAYL = (m.speed_mm_per_us * m.density_g_per_cm3 for m in (BRAIN, TABLE))
INNER_OVER_FRONT = (
    (1.0 - BONE_REFLECTION**2) * (BRAIN_MRAYL - BONE_MRAYL) / (BRAIN_MRAYL + BONE_MRAYL)
) / BONE_REFLECTION  # nominal, without attenuation; negative


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """The strongest peaks behind the front echo, shape (n, CANDIDATES), in order of time."""

    lag_us: Floats  # of the envelope, after the front echo
    phase_rad: Floats  # of the peak; 0 where its sign is that of an inner echo
    level: Floats  # amplitude over that of a nominal inner echo at this depth
    noise: Floats  # rms of the noise on the same scale
    exists: Bools  # False: fewer peaks than that

    @classmethod
    def concatenate(cls, parts: Sequence["Candidates"]) -> "Candidates":
        """Return the candidates of several blocks as one."""
        none = np.zeros((0, CANDIDATES))
        return cls(
            np.concatenate([none, *(p.lag_us for p in parts)]),
            np.concatenate([none, *(p.phase_rad for p in parts)]),
            np.concatenate([none, *(p.level for p in parts)]),
            np.concatenate([none, *(p.noise for p in parts)]),
            np.concatenate([none.astype(np.bool_), *(p.exists for p in parts)]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class InnerChoice:
    """The inner echo of each A-scan (n,)."""

    lag_us: Floats  # after the front echo; the best guess where it is not heard
    sureness: Floats  # 0 to 1
    heard: Bools

    @classmethod
    def concatenate(cls, parts: Sequence["InnerChoice"]) -> "InnerChoice":
        """Return the choices of several blocks as one."""
        none = np.zeros(0)
        return cls(
            np.concatenate([none, *(p.lag_us for p in parts)]),
            np.concatenate([none, *(p.sureness for p in parts)]),
            np.concatenate([none.astype(np.bool_), *(p.heard for p in parts)]),
        )


def bone_gate_us(probe: ProbeModel, bone: Material) -> tuple[float, float]:
    """Return the earliest and the latest time of an inner echo after the front echo."""
    low = max(probe.min_thickness_mm - GATE_MARGIN_MM, 0.5)
    high = probe.max_thickness_mm + GATE_MARGIN_MM
    return 2.0 * low / bone.speed_mm_per_us, 2.0 * high / bone.speed_mm_per_us


def bone_filter(template: Template, bone: Material, thickness_mm: float) -> Complexes:
    """Return the spectrum (f,) of an inner echo at its nominal delay: lower, duller, inverted."""
    f = template.frequencies_mhz
    at_centre = 2.0 * np.pi * f / bone.speed_mm_per_us
    loss = np.exp(-2j * (bone.wavenumber_per_mm(f) - at_centre) * thickness_mm)
    return template.spectrum * INNER_OVER_FRONT * BONE_REFLECTION * loss


def find_candidates(
    behind: Complexes, noise: Floats, template: Template, bone: Material
) -> Candidates:
    """Return the peaks in spectra (n, f) aligned to their fronts and cleared of them.

    Args:
        behind: Spectra without front echo, which was at time 0.
        noise: RMS of the noise in each trace sample, shape (n,).
        template: Of the probe and excitation.
        bone: Nominal bone; its speed turns the range of thicknesses into one of time.
    """
    probe, step, speed = template.probe, template.step_us, bone.speed_mm_per_us
    low, high = bone_gate_us(probe, bone)
    first, last = int(low / step), int(np.ceil(high / step))
    lags = np.arange(first, last + 1, dtype=np.float64) * step
    depths = np.arange(probe.min_thickness_mm, probe.max_thickness_mm + BANK_STEP_MM, BANK_STEP_MM)
    z = np.zeros((len(behind), len(lags)), dtype=np.complex128)
    gain = np.zeros(len(lags))
    for depth in depths:  # every lag takes its share from the two nearest templates
        share = np.clip(
            1.0 - np.abs(_clamped(lags * speed / 2.0, depths) - depth) / BANK_STEP_MM, 0, 1
        )
        if not share.any():
            continue
        matched = bone_filter(template, bone, float(depth))
        rms = template.noise_gain(matched)
        # peaks are sought over the noise: amplitudes over the nominal echo rise steeply with depth
        z += share * template.compress(behind, matched)[:, first : last + 1] / rms
        gain += share * rms
    z *= np.exp(2j * np.pi * template.carrier_mhz * lags)
    level = np.abs(z)
    peaks = np.zeros(level.shape, dtype=bool)
    peaks[:, 1:-1] = (level[:, 1:-1] > level[:, :-2]) & (level[:, 1:-1] >= level[:, 2:])
    ranked = np.argsort(np.where(peaks, level, 0.0), axis=1)[:, -CANDIDATES:]
    at = np.sort(ranked, axis=1)
    rows = np.arange(len(z))
    offset = np.stack([peak_offsets(level, column) for column in at.T], axis=1)
    phase = np.angle(z[rows[:, None], at]) + 2 * np.pi * template.carrier_mhz * offset * step
    return Candidates(
        lag_us=(first + at + offset) * step,
        phase_rad=np.angle(np.exp(1j * phase)),
        level=level[rows[:, None], at] * gain[at],
        noise=noise[:, None] * gain[at],
        exists=np.take_along_axis(peaks, at, axis=1),
    )


def _clamped(depth_mm: Floats, depths_mm: Floats) -> Floats:
    return np.clip(depth_mm, depths_mm[0], depths_mm[-1])
