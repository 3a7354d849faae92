"""Likelihood of every time and slope of an inner echo, of each A-scan by itself.

An oblique boundary filters its echo by the transform of the beam along the slope of its time
(``oblique_correction.py``), so that the matched filter is one for each slope.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Floats, Ints, as_floats
from rona_core.ultrasound.detection.single.candidates import BLOCK, Echoes
from rona_core.ultrasound.detection.single.front_echo import subtract_fronts
from rona_core.ultrasound.detection.single.inner_echo import bone_filter
from rona_core.ultrasound.probe.beam import probe_beam
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.materials import Complexes, Material
from rona_core.ultrasound.probe.probe_model import ProbeModel

Singles = NDArray[np.float32]
STEEPEST = 2.2  # slope, over that at which a disc receives nothing at the centre frequency
SLOPES = 14  # that are tried, from 0
REACH_US = 0.65  # around the time as it is: further off is another boundary
STEPS_PER_CYCLE = 18
CLUTTER = 0.8  # what the template does not know, over a nominal echo, at each frequency
ALIKE = 2.0  # neighbouring frequencies do not err on their own: so much less they count
LEAST_LEVEL = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Weighed:
    """Likelihoods of the A-scans (n,) for each slope (s,) and time (t,) about the start time."""

    slopes: Floats  # (s,) us per mm
    offsets_us: Floats  # (t,)
    likelihood: Singles  # (n, s, t) logarithm
    level: Singles  # (n, s, t) natural logarithm of the echo over a nominal one


def beam_transform(probe: ProbeModel, frequencies_mhz: Floats, slopes: Floats) -> Complexes:
    """Return what a boundary does to its echo (s, f) whose time rises by slopes (s,) in us per mm.

    It is the transform of the beam on the face of the line: 1 for a slope of 0.
    """
    beam = probe_beam(probe)
    ways = np.multiply.outer(beam.frequencies_mhz, beam.points_mm[:, 0])  # (f, rays)
    flat = beam.weights.sum(axis=0)
    seen = np.stack(
        [(beam.weights.T * np.exp(-2j * np.pi * ways * s)).sum(axis=1) / flat for s in slopes]
    )
    known = beam.frequencies_mhz
    return np.stack(
        [
            np.interp(frequencies_mhz, known, row.real)
            + 1j * np.interp(frequencies_mhz, known, row.imag)
            for row in seen
        ]
    )


def weigh_slopes(echoes: Echoes, lag_us: Floats, rows: Ints, bone: Material) -> Weighed:
    """Return the likelihoods of A-scans (rows) for times about theirs (all), in nominal bone."""
    template = echoes.template
    probe, f = template.probe, template.frequencies_mhz
    null = 1.22 / (2.0 * probe.aperture_radius_mm * probe.centre_mhz)
    slopes = as_floats(np.linspace(0.0, STEEPEST * null, SLOPES))
    step = 1.0 / (STEPS_PER_CYCLE * probe.centre_mhz)
    reach = round(REACH_US / step)
    offsets = as_floats(np.arange(-reach, reach + 1) * step)
    responses = beam_transform(probe, f, slopes)
    turns = template.shift(offsets).T  # (f, t)
    parts = [
        _block(echoes, lag_us, rows[k : k + BLOCK], bone, responses, turns)
        for k in range(0, len(rows), BLOCK)
    ]
    likelihood, level = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Weighed(slopes, offsets, likelihood, level)


def _block(
    echoes: Echoes,
    lag_us: Floats,
    rows: Ints,
    bone: Material,
    responses: Complexes,
    turns: Complexes,
) -> tuple[Singles, Singles]:
    template = echoes.template
    lag = lag_us[rows]
    behind = subtract_fronts(echoes.aligned[rows], template) * template.shift(lag)
    echo = bone_filter(template, bone, lag * bone.speed_mm_per_us / 2.0)
    noise = GRID * np.maximum(echoes.noise[rows], 1e-9)[:, None] ** 2
    weights = 1.0 / (noise + (CLUTTER * np.abs(echo)) ** 2)
    shape = len(rows), len(responses), turns.shape[1]
    likelihood, level = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    matched = (behind * weights * np.conj(echo)).astype(np.complex64)
    energies = (weights * np.abs(echo) ** 2) @ (np.abs(responses) ** 2).T
    single = turns.astype(np.complex64)
    for k, response in enumerate(np.conj(responses).astype(np.complex64)):
        output = np.maximum(((matched * response) @ single).real, 0.0)
        energy = energies[:, k, None]
        likelihood[:, k] = output**2 / energy / ALIKE
        level[:, k] = np.log(np.maximum(output / energy, LEAST_LEVEL))
    return likelihood, level
