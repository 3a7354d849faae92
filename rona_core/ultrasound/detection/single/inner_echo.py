"""Candidates for the inner echo: peaks of what is left behind the front echo.

The search uses the envelope, since the phase of a broadband echo repeats every cycle. With each
peak go the features that separate an inner echo from clutter: its sign, its level, what came
before, and that nothing comes after it, for the inner boundary is the last one.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import i0e

from rona_core.devices.probes import PROBE_DATA
from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.detection.single.matched_filter import (
    BONE_REFLECTION,
    Template,
    peak_offsets,
    row_medians,
)
from rona_core.ultrasound.probe.materials import BRAIN, TABLE, Complexes, Material
from rona_core.ultrasound.probe.probe_model import ProbeModel

STEP_MM = 0.1  # of the grid of depths
LEVELS = (0.05, 0.1, 0.2, 0.4, 0.8)  # of the echo over a nominal one, each as likely
MOST = 4.0  # log likelihood ratio that a single A-scan can have
ABSENT = 0.6  # share of A-scans in which the echo may be missing, tilted away
CANDIDATES = 12  # kept for each A-scan
BANK_STEP_MM = 2.0  # thickness between templates
NEAREST = 0.65  # of the least thickness: sought from here, so that what is too thin is seen
FAR_MARGIN_MM = 1.5  # and beyond it
BRAIN_MRAYL, BONE_MRAYL = (m.speed_mm_per_us * m.density_g_per_cm3 for m in (BRAIN, TABLE))
INNER_OVER_FRONT = (
    (1.0 - BONE_REFLECTION**2) * (BRAIN_MRAYL - BONE_MRAYL) / (BRAIN_MRAYL + BONE_MRAYL)
) / BONE_REFLECTION  # nominal, without attenuation; negative
GUARD = 0.9  # over the -6 dB bandwidth: closer than this, peaks are one echo


def depth_grid(low_mm: float, high_mm: float) -> Floats:
    """Return the depths (m,) between which the thickness is sought."""
    count = int(np.ceil((high_mm - low_mm) / STEP_MM)) + 1
    return low_mm + STEP_MM * np.arange(count, dtype=np.float64)


def depth_log_likelihood(
    level: Floats, noise: Floats, gain: Floats, lags_us: Floats, wanted_us: Floats, clutter: float
) -> tuple[Floats, Floats]:
    """Return log likelihood ratios (n, m) of an inner echo at given lags against none there.

    Args:
        level: Envelopes (n, lags) behind the bank of templates.
        noise: RMS of the noise on the same scale (n,).
        gain: What turns that scale into levels over a nominal echo (lags,).
        lags_us: Even steps of time (lags,).
        wanted_us: Within those (m,).
        clutter: RMS of the clutter over a nominal echo.

    With them comes the level over the noise (n, m).
    """
    at = (wanted_us - lags_us[0]) / (lags_us[1] - lags_us[0])
    low = np.clip(np.floor(at).astype(np.int64), 0, len(lags_us) - 2)
    share = np.clip(at - low, 0.0, 1.0)
    observed = (1.0 - share) * level[:, low] + share * level[:, low + 1]
    scale = (1.0 - share) * gain[low] + share * gain[low + 1]
    spread = np.sqrt(np.maximum(noise[:, None], 1e-12) ** 2 + (clutter / scale) ** 2)
    ratio = np.zeros(observed.shape)
    for over_nominal in LEVELS:
        echo = over_nominal / scale / spread
        x = 2.0 * echo * observed / spread
        # Rice over Rayleigh: I0(x) exp(-echo^2), with I0(x) = i0e(x) exp(x)
        ratio += i0e(x) * np.exp(np.clip(x - echo**2, -50.0, 50.0)) / len(LEVELS)
    log_ratio = np.log(ABSENT + (1.0 - ABSENT) * np.minimum(ratio, np.exp(MOST)))
    return log_ratio, observed / np.maximum(noise[:, None], 1e-12)


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """The strongest peaks behind the front echo, shape (n, CANDIDATES), in order of time."""

    lag_us: Floats  # of the envelope, after the front echo
    phase_rad: Floats  # of the peak; 0 where its sign is that of an inner echo
    level: Floats  # amplitude over that of a nominal inner echo at this depth
    noise: Floats  # rms of the noise on the same scale
    clutter: Floats  # median of the trace behind the front, on the same scale
    before: Floats  # largest peak ahead of this one over it, both over the noise
    after: Floats  # largest peak behind this one over it
    exists: Bools  # False: fewer peaks than that


@dataclass(frozen=True, slots=True, eq=False)
class InnerEchoes:
    """The inner echo of each A-scan (n,), and its runner-up."""

    lag_us: Floats  # after the front echo; the best guess where it is not detected
    confidence: Floats  # 0 to 1: probability that this is the inner echo
    detected: Bools
    sigma_us: Floats  # of the lag, if this is the inner echo, in this cycle
    slip_chance: Floats  # 0 to 1: that the lag is a whole cycle off
    alternative_us: Floats  # lag of the runner-up
    alternative_confidence: Floats  # 0: there is none


def bone_gate_us(probe: ProbeModel, bone: Material) -> tuple[float, float]:
    """Return the earliest and the latest time of an inner echo after the front echo."""
    low = NEAREST * probe.min_thickness_mm
    high = probe.max_thickness_mm + FAR_MARGIN_MM
    return 2.0 * low / bone.speed_mm_per_us, 2.0 * high / bone.speed_mm_per_us


def inner_grid_mm(probe: ProbeModel, bone: Material) -> Floats:
    """Return the depths (m,) between which an inner boundary is sought."""
    low, high = (t * bone.speed_mm_per_us / 2.0 for t in bone_gate_us(probe, bone))
    return depth_grid(low, high)


def bone_filter(template: Template, bone: Material, thickness_mm: float | Floats) -> Complexes:
    """Return the spectrum (..., f) of an inner echo at its delay: lower, duller, inverted.

    Args:
        template: Of the probe and excitation.
        bone: Nominal bone, whose loss and dispersion over the thickness are in it.
        thickness_mm: One, or one per A-scan (n,).
    """
    f = template.frequencies_mhz
    at_centre = 2.0 * np.pi * f / bone.speed_mm_per_us
    loss = np.multiply.outer(thickness_mm, -2j * (bone.wavenumber_per_mm(f) - at_centre))
    return template.spectrum * INNER_OVER_FRONT * BONE_REFLECTION * np.exp(loss)


def find_candidates(
    behind: Complexes, noise: Floats, template: Template, bone: Material
) -> tuple[Candidates, Floats, Floats]:
    """Return the peaks in spectra (n, f) aligned to their fronts and cleared of them.

    The other arrays (n, m) are the log likelihood ratio at each depth of ``inner_grid_mm``, and the
    level over the noise there.

    Args:
        behind: Spectra without front echo, which was at time 0.
        noise: RMS of the noise in each trace sample, shape (n,).
        template: Of the probe and excitation.
        bone: Nominal bone; its speed turns the range of thicknesses into one of time.
    """
    probe, step = template.probe, template.step_us
    low, high = bone_gate_us(probe, bone)
    first, last = int(low / step), int(np.ceil(high / step))
    z, gain = through_bank(behind, template, bone, first, last)
    level = np.abs(z)
    peaks = np.zeros(level.shape, dtype=bool)
    peaks[:, 1:-1] = (level[:, 1:-1] > level[:, :-2]) & (level[:, 1:-1] >= level[:, 2:])
    ranked = np.argsort(np.where(peaks, level, 0.0), axis=1)[:, -CANDIDATES:]
    at = np.sort(ranked, axis=1)
    rows = np.arange(len(z))[:, None]
    offset = np.stack([peak_offsets(level, column) for column in at.T], axis=1)
    phase = np.angle(z[rows, at]) + 2 * np.pi * template.carrier_mhz * offset * step
    height = np.maximum(level[rows, at], 1e-12)
    guard = int(GUARD / (probe.bandwidth * probe.centre_mhz) / step)
    before = np.maximum.accumulate(level, axis=1)[rows, np.maximum(at - guard, 0)]
    behind_it = np.maximum.accumulate(level[:, ::-1], axis=1)[:, ::-1]
    after = behind_it[rows, np.minimum(at + guard, level.shape[1] - 1)]
    lags = np.arange(first, last + 1, dtype=np.float64) * step
    wanted = 2.0 * inner_grid_mm(probe, bone) / bone.speed_mm_per_us
    found = Candidates(
        lag_us=(first + at + offset) * step,
        phase_rad=np.angle(np.exp(1j * phase)),
        level=height * gain[at],
        noise=noise[:, None] * gain[at],
        clutter=row_medians(level)[:, None] * gain[at],
        before=before / height,
        after=after / height,
        exists=np.take_along_axis(peaks, at, axis=1),
    )
    return found, *depth_log_likelihood(level, noise, gain, lags, wanted, _clutter(probe))


def _clutter(probe: ProbeModel) -> float:
    """Return the level of the clutter, between those of the probes of the catalogue."""
    known = sorted((one.centre_mhz, one.clutter) for one in PROBE_DATA.values())
    mhz, levels = zip(*known, strict=True)
    return float(np.interp(np.log(probe.centre_mhz), np.log(mhz), levels))


def through_bank(
    behind: Complexes, template: Template, bone: Material, first: int, last: int
) -> tuple[Complexes, Floats]:
    """Return outputs (n, lags) over the noise gain, and that gain (lags,).

    Peaks are sought over the noise: amplitudes over the nominal echo rise steeply with depth.
    """
    probe, step, speed = template.probe, template.step_us, bone.speed_mm_per_us
    lags = np.arange(first, last + 1, dtype=np.float64) * step
    depths = np.arange(probe.min_thickness_mm, probe.max_thickness_mm + BANK_STEP_MM, BANK_STEP_MM)
    at = np.clip(lags * speed / 2.0, depths[0], depths[-1])
    bank = np.zeros((len(lags), len(template.bins)), dtype=np.complex128)
    gain = np.zeros(len(lags))
    for depth in depths:  # every lag takes its share from the two nearest templates
        share = np.clip(1.0 - np.abs(at - depth) / BANK_STEP_MM, 0.0, 1.0)
        echo = bone_filter(template, bone, float(depth))
        weighed = template.weighed_for(echo)
        rms = weighed.noise_gain(echo)
        bank += np.multiply.outer(share, weighed.matched(echo) / rms)
        gain += share * rms
    return behind @ (bank * template.shift(lags)).T, gain
