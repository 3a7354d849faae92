"""The echo of a layered bone under an A-mode probe: exact layers per ray, beam by reciprocity.

The face of the delay line is sampled by about a hundred rays. Each sees its own line, gel, tables
and diploe; their reflections, all multiples included, are added with the squared incident field.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.arrays import Bools, Floats
from rona_core.devices.settings import Excitation
from rona_core.errors import InvalidInputError
from rona_core.ultrasound.beam import WINDOW, probe_beam
from rona_core.ultrasound.layers import ramp, stack_reflection, step
from rona_core.ultrasound.material import Complexes
from rona_core.ultrasound.medium import Medium
from rona_core.ultrasound.probe import FULL_SCALE_SHARE, ProbeModel
from rona_core.ultrasound.pulse import (
    GRID,
    excitation_spectrum,
    grid_frequencies_mhz,
    transducer_response,
)
from rona_core.ultrasound.texture import AXIAL_CELL_MM, cells, grains

AIR_REFLECTION = -1.0
SPECKLE_CELLS = 54  # of diploe, 8 mm deep
GAP_LIMIT_MM = 4.0  # a ray further than this from the bone is lost


@dataclass(frozen=True, slots=True, eq=False)
class LayerProfile:
    """What each ray of the beam (n,) meets, all along the probe axis, in millimetres."""

    outer_mm: Floats  # face of the uncompressed line to bone; negative where the bone is inside it
    table_mm: Floats
    diploe_mm: Floats
    inner_table_mm: Floats
    hit: Bools  # False: the ray misses the bone
    entries_skull: Floats  # (n, 3) where the rays enter the bone, names the cells of the texture


def echo_bands(
    weights: Complexes, line: Complexes, gel: Complexes, bone: Complexes, face: Complexes
) -> Complexes:
    """Return the echo (f,): rays (n, f) with a phase in line and gel, bone behind them, added.

    Args:
        weights: Area times squared incident field.
        line: exp(-2 j k d) for the change of the line's length.
        gel: exp(-2 j k d) for the gap filled with gel.
        bone: Reflection of the bone seen from the gel.
        face: Reflection (f,) of the step from line to gel.
    """
    behind = gel * bone
    return np.sum(weights * line * (face + (1.0 - face**2) * behind / (1.0 + face * behind)), 0)


class EchoModel:
    """Echoes of one probe, medium and excitation; everything that does not change is prepared."""

    def __init__(
        self, probe: ProbeModel, excitation: Excitation, medium: Medium, seed: int
    ) -> None:
        self.probe, self.medium, self.seed = probe, medium, seed
        self._beam = probe_beam(probe)
        f = self._beam.frequencies_mhz
        self._k_line = probe.line.wavenumber_per_mm(f)
        self._k_gel = medium.gel.wavenumber_per_mm(f)
        self._k_table = medium.table.wavenumber_per_mm(f)
        self._k_diploe = medium.diploe.wavenumber_per_mm(f)
        gel, table = medium.gel.impedance(f), medium.table.impedance(f)
        self._face = step(probe.line.impedance(f), gel).near
        self._outer = step(gel, table)
        self._into_diploe = ramp(medium.table, medium.diploe, medium.ramp_mm, f)
        self._into_table = ramp(medium.diploe, medium.table, medium.ramp_mm, f)
        self._inner = step(table, medium.brain.impedance(f))
        depth = (np.arange(SPECKLE_CELLS) + 0.5) * AXIAL_CELL_MM
        self._speckle = medium.speckle * np.exp(-2j * self._k_diploe[None, :] * depth[:, None])
        self._response = transducer_response(probe, f)
        self._long = excitation_spectrum(probe, excitation) * self._second_line_echo()
        self._n = probe.n_samples(excitation)
        self.gain = 1.0
        self.gain = FULL_SCALE_SHARE / float(np.abs(self.perfect_front()).max())

    @property
    def ray_points_mm(self) -> Floats:
        """Where the rays leave the face (n, 2), in probe x and y."""
        return self._beam.points_mm

    def trace(self, profile: LayerProfile) -> Floats:
        """Return the noiseless record (samples,) over a bone, in units of full scale.

        Raises:
            InvalidInputError: the profile has another number of rays than the beam.
        """
        if len(profile.outer_mm) != len(self._beam.points_mm):
            raise InvalidInputError(
                f"the profile has {len(profile.outer_mm)} rays, the beam "
                f"{len(self._beam.points_mm)}"
            )
        return self._record(self._bone_echo(profile))

    def lifted(self) -> Floats:
        """Return the record (samples,) of the probe in the air: its face is a mirror."""
        return self._record(AIR_REFLECTION * self._beam.weights.sum(axis=0))

    def perfect_front(self) -> Floats:
        """Return the record (samples,) of endless flat bone, perpendicular, behind the gel film."""
        film = self.probe.film_mm
        gel = np.exp(-2j * self._k_gel * film)[None, :]
        line = np.exp(2j * self._k_line * film)[None, :]
        bone = self._outer.near[None, :]
        return self._record(echo_bands(self._beam.weights, line, gel, bone, self._face))

    def _bone_echo(self, profile: LayerProfile) -> Complexes:
        medium = self.medium
        keys = cells(profile.entries_skull, self.seed)
        rough = grains(keys, 2) * (medium.outer_roughness_mm, medium.inner_roughness_mm)
        outer_mm = profile.outer_mm + rough[:, 0]
        half_ramp = medium.ramp_mm / 2.0
        table_mm = profile.table_mm - rough[:, 0] - half_ramp
        inner_mm = profile.inner_table_mm + rough[:, 1] - half_ramp
        gel_mm = np.maximum(outer_mm, self.probe.film_mm)
        kept = profile.hit & (outer_mm < GAP_LIMIT_MM)

        bone = self._inner.near * _there_and_back(self._k_table, inner_mm)
        bone = self._into_table.seen_with(bone)
        bone = bone * _there_and_back(self._k_diploe, profile.diploe_mm - medium.ramp_mm)
        if medium.speckle > 0.0:
            depth = (np.arange(SPECKLE_CELLS) + 0.5) * AXIAL_CELL_MM
            grain = grains(keys ^ np.uint64(0x5EED), SPECKLE_CELLS)
            grain[depth[None, :] > profile.diploe_mm[:, None] - medium.ramp_mm] = 0.0
            bone += grain @ self._speckle
        bone = self._into_diploe.seen_with(bone)
        bone = bone * _there_and_back(self._k_table, table_mm)
        bone = self._outer.seen_with(bone) * kept[:, None]
        gel = _there_and_back(self._k_gel, gel_mm)
        line = _there_and_back(self._k_line, outer_mm - gel_mm)  # <= 0: the line gives way
        return echo_bands(self._beam.weights, line, gel, bone, self._face)

    def _second_line_echo(self) -> Complexes:
        """Return 1 + the reverberation in the line (f,), for a front echo off bone."""
        probe, f = self.probe, grid_frequencies_mhz(self.probe)
        audible = np.maximum(f, 1e-3)
        front = stack_reflection((self.medium.gel, self.medium.table), (), audible)
        there = np.exp(-2j * probe.line.wavenumber_per_mm(audible) * probe.line_length_mm)
        return 1.0 + probe.crystal_reflection * front * there

    def _record(self, spectrum: Complexes) -> Floats:
        """Return the record (samples,) of an echo spectrum (f,) without the line's delay."""
        probe, beam = self.probe, self._beam
        ahead_us = probe.line_delay_us - probe.start_us
        window = np.zeros(WINDOW // 2 + 1, dtype=np.complex128)
        delay = np.exp(-2j * np.pi * beam.frequencies_mhz * ahead_us)
        window[beam.bins] = spectrum * self._response * delay
        response = np.fft.irfft(window, WINDOW)  # from start_us on; all echoes end inside it
        long = np.fft.rfft(response, GRID)
        return self.gain * np.fft.irfft(long * self._long, GRID)[: self._n]


def _there_and_back(k_per_mm: Complexes, thickness_mm: Floats) -> Complexes:
    """Return exp(-2 j k d) for wavenumbers (f,) and distances (n,), shape (n, f)."""
    return np.exp(np.multiply.outer(thickness_mm, -2j * k_per_mm))
