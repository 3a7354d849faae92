"""Expected performance of a probe and an excitation: sigma and depth range, before measuring.

The bound of Cramer and Rao for a nominal inner echo in the receiver's noise, and the depth down to
which that echo stands out. Rough surfaces, scatter and tilt come on top: no probe does better.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.settings import Excitation, ProbeName, ProbeSettings
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats, readonly
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US, nominal_bone
from rona_core.ultrasound.detection.single.inner_echo import bone_filter
from rona_core.ultrasound.detection.single.matched_filter import block_template
from rona_core.ultrasound.detection.single.time_of_flight import Fisher, amplitude_bound
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.probe_model import FULL_SCALE_SHARE, probe_model

THICKNESS_MM = (3.0, 4.0, 6.0, 8.0, 10.0, 12.0)
LEAST_SNR_DB = 20.0  # of the inner echo behind the matched filter
DEPTHS_MM = np.arange(1.0, 30.1, 0.25)


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedPerformance:
    """Expected performance of one probe with one excitation at some thicknesses (n,)."""

    probe: ProbeName
    excitation: Excitation
    thickness_mm: Floats
    sigma_mm: Floats  # (n,) least standard deviation of the thickness, by noise alone
    snr_db: Floats  # (n,) inner echo behind the matched filter over the noise
    least_mm: float  # depth range
    most_mm: float

    def reaches(self, thickness_mm: float) -> bool:
        """Return whether a thickness lies within the depth range."""
        return self.least_mm <= thickness_mm <= self.most_mm


def expected_performance(
    settings: ProbeSettings, thickness_mm: ArrayLike = THICKNESS_MM
) -> ExpectedPerformance:
    """Return the expected performance of a probe in nominal bone.

    Raises:
        InvalidInputError: thicknesses that are not positive.
    """
    wanted = np.atleast_1d(as_floats(thickness_mm, name="thickness_mm"))
    if not 0.0 < wanted.min() <= wanted.max() <= DEPTHS_MM[-1]:
        raise InvalidInputError(f"thicknesses must be above 0 and at most {DEPTHS_MM[-1]:g} mm")
    probe = probe_model(settings)
    sigma_mm, snr_db = _at(settings, wanted)
    deep = _at(settings, DEPTHS_MM)[1] >= LEAST_SNR_DB
    most = float(DEPTHS_MM[deep][-1]) if deep.any() else 0.0
    return ExpectedPerformance(
        probe=settings.name,
        excitation=settings.excitation,
        thickness_mm=readonly(wanted),
        sigma_mm=readonly(sigma_mm),
        snr_db=readonly(snr_db),
        least_mm=probe.min_thickness_mm,
        most_mm=min(most, probe.max_thickness_mm),
    )


def expected_performances(settings: ProbeSettings) -> tuple[ExpectedPerformance, ...]:
    """Return those of each probe and excitation; what was edited counts for its own probe."""
    names: tuple[ProbeName, ...] = ("2.25MHz", "1MHz")
    kinds: tuple[Excitation, ...] = ("pulse", "chirp")
    unedited = ProbeSettings(front_snr_db=settings.front_snr_db, pitch_mm=settings.pitch_mm)
    return tuple(
        expected_performance(
            replace(settings if name == settings.name else unedited, name=name, excitation=kind)
        )
        for name in names
        for kind in kinds
    )


def _at(settings: ProbeSettings, thickness_mm: Floats) -> tuple[Floats, Floats]:
    """Return least sigma in mm and signal over noise in dB at thicknesses (n,)."""
    probe = probe_model(settings)
    template = block_template(probe, settings.excitation)
    band = probe.bandwidth * probe.centre_mhz / (probe.sampling_mhz / 2.0)
    noise = FULL_SCALE_SHARE * 10.0 ** (-settings.front_snr_db / 20.0) / np.sqrt(band)
    echoes = bone_filter(template, nominal_bone(), thickness_mm)
    weights = np.full(len(template.frequencies_mhz), 1.0 / (GRID * noise**2))
    fisher = Fisher.of(echoes, weights, template.frequencies_mhz)
    coherent_us = amplitude_bound(fisher, np.ones(len(thickness_mm)))[0]
    snr = np.sqrt(2.0 * np.maximum(fisher.energy, 1e-30))
    return coherent_us * NOMINAL_SPEED_MM_PER_US / 2.0, 20.0 * np.log10(snr)
