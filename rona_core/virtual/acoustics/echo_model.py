"""The echo of a layered bone under an A-mode probe: exact layers per ray, beam by reciprocity.

The face of the delay line is sampled by about a hundred rays. Each sees its own line, gel, tables
and diploe; their reflections, all multiples included, are added with the squared incident field.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from rona_core.devices.settings import Excitation
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.probe.beam import WINDOW, probe_beam
from rona_core.ultrasound.probe.excitation import (
    GRID,
    excitation_spectrum,
    grid_frequencies_mhz,
    transducer_response,
)
from rona_core.ultrasound.probe.materials import Complexes
from rona_core.ultrasound.probe.probe_model import ProbeModel
from rona_core.virtual.acoustics.layer_stack import BoneStack, LayerProfile, Phasors, Spreading
from rona_core.virtual.acoustics.layered_reflection import stack_reflection
from rona_core.virtual.acoustics.medium import Medium

AIR_REFLECTION = -1.0


class EchoModel:
    """Echoes of one probe, medium and excitation; everything that does not change is prepared."""

    def __init__(
        self,
        probe: ProbeModel,
        excitation: Excitation,
        medium: Medium,
        seed: int,
        *,
        true: ProbeModel | None = None,
        gain: float | None = None,
        exact: bool = False,
    ) -> None:
        """Prepare the beam and the layers.

        Args:
            probe: Transducer, nominal line and converter; says when the record starts.
            excitation: What is sent.
            medium: Gel and bone.
            seed: Of the texture of the bone.
            true: The true probe, where line or crystal differ from their stated values.
            gain: Of the receiver; None: as it is set on nominal bone.
            exact: Count the layers with 53 bits instead of 24: the reference, and slower.
        """
        self.probe, self.medium, self.seed = probe, medium, seed
        self._true = probe if true is None else true
        self._beam = probe_beam(self._true)
        f = self._beam.frequencies_mhz
        self._stack = BoneStack(
            self._true.line,
            medium,
            f,
            film_mm=medium.film_mm,
            seed=seed,
            spreading=_spreading(self._true),
            exact=exact,
        )
        self._weights: Phasors = self._beam.weights
        if not exact:
            self._weights = self._beam.weights.astype(np.complex64)
        self._response = transducer_response(self._true, f)
        self._long = excitation_spectrum(probe, excitation) * self._second_line_echo()
        self._n = probe.n_samples(excitation)
        self.gain = receiver_gain(probe, excitation) if gain is None else gain

    @property
    def ray_points_mm(self) -> Floats:
        """Where the rays leave the face (n, 2), in probe x and y."""
        return self._beam.points_mm

    def trace(self, profile: LayerProfile) -> Floats:
        """Return the noiseless record (samples,) over a bone, in units of full scale.

        Raises:
            InvalidInputError: the profile has another number of rays than the beam.
        """
        return self.traces((profile,))[0]

    def traces(self, profiles: Sequence[LayerProfile], late_us: Floats | None = None) -> Floats:
        """Return the noiseless records (n, samples) over n bones, in units of full scale.

        Args:
            profiles: Layers under the rays (n).
            late_us: By how much the line of the moment delays each echo (n,); None: not at all.

        Raises:
            InvalidInputError: a profile has another number of rays than the beam.
        """
        spectra = np.zeros((len(profiles), len(self._beam.bins)), dtype=np.complex128)
        for profile in profiles:
            if len(profile.outer_mm) != len(self._beam.points_mm):
                raise InvalidInputError(
                    f"the profile has {len(profile.outer_mm)} rays, the beam "
                    f"{len(self._beam.points_mm)}"
                )
        if len(profiles):
            spectra[:] = list(self._stack.echoes(self._weights, profiles))
        if late_us is not None:
            turns = np.multiply.outer(late_us, self._beam.frequencies_mhz)
            spectra *= np.exp(-2j * np.pi * turns)
        return self._record(spectra)

    def lifted(self) -> Floats:
        """Return the record (samples,) of the probe in the air: its face is a mirror."""
        return self._record(AIR_REFLECTION * self._beam.weights.sum(axis=0))

    def perfect_front(self) -> Floats:
        """Return the record (samples,) of endless flat bone, perpendicular, behind the gel film."""
        return self._record(self._stack.front(self._weights))

    def _second_line_echo(self) -> Complexes:
        """Return 1 + the reverberation in the line (f,), for a front echo off bone."""
        probe, f = self._true, grid_frequencies_mhz(self.probe)
        audible = np.maximum(f, 1e-3)
        front = stack_reflection((self.medium.gel, self.medium.table), (), audible)
        round_trip = np.exp(-2j * probe.line.wavenumber_per_mm(audible) * probe.line_length_mm)
        return 1.0 + probe.crystal_reflection * front * round_trip

    def _record(self, spectra: Phasors) -> Floats:
        """Return records (..., samples) of echo spectra (..., f) without the line's delay."""
        probe, beam = self.probe, self._beam
        ahead_us = self._true.line_delay_us - probe.start_us
        window = np.zeros((*spectra.shape[:-1], WINDOW // 2 + 1), dtype=np.complex128)
        delay = np.exp(-2j * np.pi * beam.frequencies_mhz * ahead_us)
        window[..., beam.bins] = spectra * (self._response * delay)
        response = np.fft.irfft(window, WINDOW)  # from start_us on; all echoes end inside it
        long = np.fft.rfft(response, GRID)
        return self.gain * np.fft.irfft(long * self._long, GRID)[..., : self._n]


@lru_cache(maxsize=8)
def _spreading(probe: ProbeModel) -> Spreading:
    return Spreading(probe, probe_beam(probe))


@lru_cache(maxsize=16)
def receiver_gain(probe: ProbeModel, excitation: Excitation) -> float:
    """Return the gain at which a perfect front echo of nominal bone has its share of the scale.

    It is set once for a probe: a harder bone or a warm line changes the echo and not the gain.
    """
    front = EchoModel(probe, excitation, Medium(), 0, gain=1.0).perfect_front()
    return probe.front_share / float(np.abs(front).max())
