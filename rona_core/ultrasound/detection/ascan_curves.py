"""Curves of one A-scan for display: trace, envelope, matched output, and its boundaries."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.single.front_echo import find_fronts, subtract_fronts
from rona_core.ultrasound.detection.single.matched_filter import (
    COMPRESSED,
    block_template,
    trace_spectra,
)
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.probe_model import ProbeModel


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
