"""B-scan image of a survey: depth down, A-scans across."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.detection.single.front_echo import gate_us
from rona_core.ultrasound.detection.single.matched_filter import (
    COMPRESSED,
    block_template,
    trace_spectra,
)
from rona_core.ultrasound.probe.probe_model import ProbeModel

BLOCK = 128  # A-scans at a time
BELOW_MM = 1.0  # the deepest bone that the probe can measure
SLOW_MM_PER_US = 2.45  # bone; the slowest that is published


@dataclass(frozen=True, slots=True, eq=False)
class ScanImage:
    """Levels behind the matched filter: rows are times, columns are A-scans."""

    level_db: np.typing.NDArray[np.float32]  # (depths, n) over a perfect mirror
    time_us: Floats  # (depths,) two-way, from the emission


def scan_image(track: AScanTrack, probe: ProbeModel, excitation: Excitation) -> ScanImage:
    """Return the envelope behind the equalised matched filter of all A-scans, in dB.

    A coded emission is as long as the bone is deep: only compressed does it show boundaries.
    """
    template = block_template(probe, excitation)
    times = np.arange(COMPRESSED, dtype=np.float64) * template.step_us
    early = gate_us(probe)[0]
    end_us = track.start_us + track.rf.shape[1] / track.sampling_mhz
    low = max(probe.line_delay_us + early, track.start_us)
    depth_us = 2.0 * (probe.max_thickness_mm + BELOW_MM) / SLOW_MM_PER_US
    high = min(probe.line_delay_us + depth_us, end_us)
    kept = (times >= low) & (times < high)
    levels = np.zeros((int(kept.sum()), len(track)), dtype=np.float32)
    for start in range(0, len(track), BLOCK):
        rf = track.rf[start : start + BLOCK].astype(np.float64)
        spectra = trace_spectra(rf, track.start_us, template)[0]
        compressed = np.abs(template.compress(spectra, template.spectrum))[:, kept]
        levels[:, start : start + BLOCK] = compressed.T
    level_db = (20.0 * np.log10(np.maximum(levels, 1e-9))).astype(np.float32)
    level_db.setflags(write=False)
    return ScanImage(level_db, readonly(times[kept]))
