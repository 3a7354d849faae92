"""An A-mode probe: transducer, delay line, transmitter and digitiser.

Shared by detection and by the virtual world: what a laboratory knows of its probe. The virtual
probe adds what it does not know (``virtual.acoustics.delay_line``), and noise.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rona_core.devices.probes import PROBE_DATA
from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation, ProbeSettings, PulseShape
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.probe.materials import Material

SAMPLING_MHZ = 50.0
ADC_BITS = 14
FULL_SCALE_SHARE = 0.5  # a perfect front echo peaks at this share of full scale
LEAD_US = 4.0  # the record begins this long before the echo of the uncompressed line's face
TAIL_US = 4.0  # and lasts this long after the last possible echo
RING_DOWN_US = 1.0  # between the end of a chirp and the record
SLOWEST_BONE_MM_PER_US = 2.3  # for the length of the record
AQUALENE = Material(1.60, 0.92, 0.4, 1.2)


@dataclass(frozen=True, slots=True)
class ProbeModel:
    """A disc transducer behind a compliant elastomer delay line.

    The face keeps contact while the robot misplaces it along its axis: the line gives way by up
    to ``compliance_mm`` and gel fills gaps of the same size; a film of gel always remains.
    """

    name: str
    centre_mhz: float
    aperture_radius_mm: float
    min_thickness_mm: float  # of bone that the probe resolves
    max_thickness_mm: float
    bandwidth: float  # full width at -6 dB over the centre frequency
    line_length_mm: float
    line: Material = AQUALENE
    crystal_reflection: float = 0.25  # of an echo that returns to the transducer
    compliance_mm: float = 2.0
    film_mm: float = 0.1
    sampling_mhz: float = SAMPLING_MHZ
    adc_bits: int = ADC_BITS
    pulse_shape: PulseShape = "resonant"
    gain_db: float = 0.0  # of the receiver, over the gain that leaves a front echo half the scale
    timed_for_us: float | None = None  # delay that chirp and record are set for; None: the line's

    @property
    def front_share(self) -> float:
        """Peak of a perfect front echo over full scale; above 1 the converter clips it."""
        return FULL_SCALE_SHARE * float(10.0 ** (self.gain_db / 20.0))

    @property
    def line_delay_us(self) -> float:
        """Two-way time through the uncompressed line."""
        return 2.0 * self.line_length_mm / self.line.speed_mm_per_us

    @property
    def start_us(self) -> float:
        """Time of the first recorded sample after the emission starts."""
        timed_for = self.line_delay_us if self.timed_for_us is None else self.timed_for_us
        return round((timed_for - LEAD_US) * self.sampling_mhz) / self.sampling_mhz

    @property
    def chirp_length_us(self) -> float:
        """Duration of the coded emission: as long as the line allows."""
        return self.start_us - RING_DOWN_US

    @property
    def chirp_band_mhz(self) -> float:
        """Width of the coded emission, 1.14 times the -6 dB band (Pollakowski and Ermert 1994)."""
        return 1.14 * self.bandwidth * self.centre_mhz

    def with_line_delay(self, delay_us: float) -> "ProbeModel":
        """Return the probe with another two-way time through its line, found by calibration.

        What it sends and when it records stays as it was set.
        """
        timed_for = self.line_delay_us if self.timed_for_us is None else self.timed_for_us
        line = replace(self.line, speed_mm_per_us=2.0 * self.line_length_mm / delay_us)
        return replace(self, line=line, timed_for_us=timed_for)

    def n_samples(self, excitation: Excitation) -> int:
        """Return the length of the record in samples."""
        bone_us = 2.0 * self.max_thickness_mm / SLOWEST_BONE_MM_PER_US
        emission_us = self.chirp_length_us if excitation == "chirp" else 0.0
        length_us = LEAD_US + 2.0 * self.compliance_mm / 1.5 + bone_us + emission_us + TAIL_US
        return round(length_us * self.sampling_mhz)


PROBES = {
    name: ProbeModel(
        name,
        data.centre_mhz,
        data.aperture_radius_mm,
        data.min_thickness_mm,
        data.max_thickness_mm,
        data.bandwidth,
        data.line_length_mm,
    )
    for name, data in PROBE_DATA.items()
}


def probe_model(probe: str | ProbeSettings) -> ProbeModel:
    """Return the model of a probe: by its name, or as its settings have changed it.

    It is what a laboratory knows of its probe. What it does not know, the temperature of the line,
    is not in it: the line is that of room temperature.

    Raises:
        InvalidInputError: there is no such probe.
    """
    name = probe if isinstance(probe, str) else probe.name
    if name not in PROBES:
        raise InvalidInputError(f"probe must be one of {', '.join(PROBES)}: {name!r}")
    if isinstance(probe, str):
        return PROBES[name]
    aperture_radius_mm = None if probe.aperture_mm is None else probe.aperture_mm / 2.0
    chosen: dict[str, Any] = {
        "centre_mhz": probe.centre_mhz,
        "bandwidth": probe.bandwidth,
        "aperture_radius_mm": aperture_radius_mm,
        "line_length_mm": probe.line_length_mm,
        "pulse_shape": probe.pulse_shape,
        "adc_bits": probe.adc_bits,
        "gain_db": probe.gain_db,
    }
    return replace(PROBES[name], **{k: value for k, value in chosen.items() if value is not None})


@dataclass(frozen=True, slots=True, eq=False)
class ProbeSurvey:
    """A-scans (n) of one probe; without positions in the order of the path.

    Args:
        track: The A-scans.
        probe: The probe that took them.
        excitation: What it sent.
        positions_mm: Where the probe stood (n, 3), in any fixed frame; None: not known, the
            A-scans support those before and after them only.
        axes: Of the probe, into the bone (n, 3), in the frame of the positions; None: not known.
        known_standoff_mm: Where the outer boundary is (n,), along the axis from the face of the
            uncompressed line, if that is known better than from these A-scans: a probe that is
            tilted towards the inner table hardly detects it. None: found in each A-scan.

    Raises:
        InvalidInputError: another sampling rate than the probe's, or axes or stand-offs of another
            shape, or not finite.
    """

    track: AScanTrack
    probe: ProbeModel
    excitation: Excitation
    positions_mm: Floats | None = None
    axes: Floats | None = None
    known_standoff_mm: Floats | None = None

    def __post_init__(self) -> None:
        n, probe, rate = len(self.track), self.probe, self.track.sampling_mhz
        if n and rate != probe.sampling_mhz:
            raise InvalidInputError(
                f"the {probe.name} probe samples at {probe.sampling_mhz} MHz, "
                f"these A-scans were sampled at {rate} MHz"
            )
        given = (
            ("axes", self.axes, (n, 3)),
            ("known stand-offs", self.known_standoff_mm, (n,)),
        )
        for what, values, shape in given:
            if values is not None and (values.shape != shape or not np.isfinite(values).all()):
                raise InvalidInputError(
                    f"{n} A-scans need {what} of shape {shape}, all finite: "
                    f"got {values.shape}, {int(np.isfinite(values).sum())} numbers finite"
                )

    def __len__(self) -> int:
        return len(self.track)
