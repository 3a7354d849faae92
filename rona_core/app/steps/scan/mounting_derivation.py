"""The mounting of the robot's probe, calibrated on a gauge plate."""

from dataclasses import dataclass

from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.staleness import capture_input
from rona_core.app.steps.scan.messages import CalibrateProbeMounting
from rona_core.app.steps.setup.inputs import BLOCK_PROBE
from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.acoustic_calibration.probe_mounting import (
    ProbeMounting,
    calibrate_mounting,
)
from rona_core.ultrasound.probe.probe_model import probe_model


@dataclass(frozen=True, slots=True, eq=False)
class GaugeCapture:
    """The probe in its holder, pressed by a gauge plate: a track for each depth."""

    ordinal: int
    setup_digest: str
    tracks: tuple[AScanTrack, ...]
    depths_mm: Floats  # (k,)
    sigma_mm: float  # of the depths, as the gauge's maker states it
    partial: bool = False


GAUGE: Input[GaugeCapture] = capture_input("gauge")


@inputs()
class MountingInputs:
    """What the mounting of the probe is calibrated from."""

    gauge: GaugeCapture = given(GAUGE, "gauge")
    probe: ProbeSettings = given(BLOCK_PROBE, "probe")


def find_mounting(known: MountingInputs, message: CalibrateProbeMounting) -> ProbeMounting:
    """Find where the face of the probe is, and how fast its line, from the A-scans on the gauge."""
    held, probe = known.gauge, known.probe
    return calibrate_mounting(
        held.tracks, held.depths_mm, held.sigma_mm, probe_model(probe), probe.excitation
    )
