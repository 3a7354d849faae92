"""Display of A-scans: the curves of one with its boundaries, and the B-scan image of all."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.single.front_echo import find_fronts, gate_us, subtract_fronts
from rona_core.ultrasound.detection.single.matched_filter import (
    COMPRESSED,
    block_template,
    trace_spectra,
)
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.probe_model import ProbeModel

BLOCK = 128  # A-scans at a time
BELOW_MM = 1.0  # the deepest bone that the probe can measure
SLOW_MM_PER_US = 2.45  # bone; the slowest that is published


@dataclass(frozen=True, slots=True, eq=False)
class AScanView:
    """An A-scan and its filtered versions on one time axis (m,), and what was found."""

    time_us: Floats  # two-way time after the emission starts
    rf: Floats  # in units of the converter's full scale
    envelope: Floats  # of the trace in the probe's band
    matched_us: Floats  # time axis of the next two: an echo stands where it arrives
    matched: Floats  # envelope behind the equalised matched filter, 1 for a perfect mirror
    behind_front: Floats  # the same with the front echo subtracted
    outer_us: float | None  # None: not found
    inner_us: float | None
    flag: int | None  # of the detection, None without one


def preview(
    track: AScanTrack,
    i: int,
    probe: ProbeModel,
    excitation: Excitation,
    detection: Detection | None = None,
) -> AScanView:
    """Return A-scan number ``i`` of a survey, with the boundaries of a detection if given.

    Raises:
        InvalidInputError: there is no such A-scan, or the detection is of another survey.
    """
    if not 0 <= i < len(track):
        raise InvalidInputError(f"there are {len(track)} A-scans, and none of number {i}")
    if detection is not None and len(detection) != len(track):
        raise InvalidInputError(
            f"the detection is of {len(detection)} A-scans, the survey has {len(track)}"
        )
    template = block_template(probe, excitation)
    rf = track.rf[i : i + 1].astype(np.float64)
    spectra, noise = trace_spectra(rf, track.start_us, template)
    front = find_fronts(spectra, noise, template)
    arrival_us = probe.line_delay_us + front.delay_us
    behind = subtract_fronts(spectra * template.shift(arrival_us), template)
    behind = behind * template.shift(-arrival_us)
    end_us = track.start_us + rf.shape[1] / track.sampling_mhz
    matched_us = np.arange(COMPRESSED, dtype=np.float64) * template.step_us
    kept = (matched_us >= track.start_us) & (matched_us < end_us)
    matched, cleared = (
        np.abs(template.compress(s, template.spectrum))[0, kept] for s in (spectra, behind)
    )
    analytic = np.zeros(GRID, dtype=np.complex128)
    analytic[template.bins] = spectra[0]
    first = round(track.start_us * track.sampling_mhz)
    envelope = 2.0 * np.abs(np.fft.ifft(analytic))[first : first + rf.shape[1]]
    outer_ok = detection is not None and bool(detection.outer_ok[i])
    inner_ok = detection is not None and bool(detection.inner_ok[i])
    samples = np.arange(rf.shape[1], dtype=np.float64)
    return AScanView(
        time_us=readonly(track.start_us + samples / track.sampling_mhz),
        rf=readonly(rf[0]),
        envelope=readonly(envelope),
        matched_us=readonly(matched_us[kept]),
        matched=readonly(matched),
        behind_front=readonly(cleared),
        outer_us=float(detection.outer_us[i]) if detection is not None and outer_ok else None,
        inner_us=float(detection.inner_us[i]) if detection is not None and inner_ok else None,
        flag=int(detection.flag[i]) if detection is not None else None,
    )


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
