"""What is shown of probe, delay line, speed of sound, sweep and the error of a thickness."""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from rona_core.app.dependencies.judge import fresh, judge_part
from rona_core.app.dependencies.staleness import made_of, stale_reason
from rona_core.app.steps.acoustics.derivation import ECHO_DEPTHS, with_known_speed
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.pose import Poses
from rona_core.mapping.boundary_map import Maps
from rona_core.session.document import Session
from rona_core.session.memo import remember
from rona_core.ultrasound.acoustic_calibration.expected_performance import (
    ExpectedPerformance,
    WhatIf,
    expected_performances,
)
from rona_core.ultrasound.acoustic_calibration.point_weights import LEAST_POINTS
from rona_core.ultrasound.acoustic_calibration.reference_points import (
    EchoDepths,
    ReferenceProposal,
    propose_references,
)
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    speed_uncertainty,
    uncalibrated,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import PATIENTS_SHARE
from rona_core.ultrasound.detection.detect import (
    NOMINAL_LOSS_DB_PER_CM,
    Detection,
    has_inner_echoes,
)
from rona_core.ultrasound.detection.spatial.detectability import MORE_LOSS
from rona_core.ultrasound.probe.probe_model import probe_model

STEEPEST = 0.3  # nine tenths of all skulls are flatter: more is a step between echoes


@dataclass(frozen=True, slots=True)
class ThicknessShares:
    """Standard deviations (RMS over the sure A-scans) of a thickness in mm; squares add up."""

    total_mm: float
    timing_mm: float  # by the time of flight
    patient_mm: float  # by the mean speed over the region
    place_mm: float  # by the speed at the place against that mean
    wedge_mm: float  # by an inner boundary that is not parallel to the outer one
    points: int  # of reference that the speed was calibrated at


def thickness_shares(session: Session) -> ThicknessShares | None:
    """Return the error budget of the map's thickness; None before step 9.

    The speed counts as calibrated if the maps were made with that calibration.
    """
    results = session.results
    if results.detection is None or results.maps is None:
        return None
    return _shares(results.detection.value, results.maps.value, speed_of_maps(session))


def speed_of_maps(session: Session, *, hand: bool = False) -> SpeedCalibration | None:
    """Return the calibration that the maps were made with; with ``hand`` those of the hand scan.

    None where they are at the published speed, or at one that was asked for in words, or where the
    session does not hold their calibration any more. Maps by hand take it in ``base`` alone.
    """
    results, speed = session.results, session.results.speed
    maps = results.sono_maps if hand else results.maps
    if maps is None or speed is None or maps.arguments.get("sound_speed_mm_per_us") is not None:
        return None
    if results.sono_maps is not None and hand and results.sono_maps.value.frame != "base":
        return None
    return speed.value if made_of(maps, "speed", speed.value) else None


def at_speed_of_maps(session: Session, detection: Detection, poses: Poses) -> Detection:
    """Return a detection with its thicknesses as the maps have them: at the speed of each place.

    As it is where the maps are at the speed that it was detected with, or there are none.

    Args:
        session: Holds the maps and the calibration that they were made with.
        detection: What was found in n A-scans.
        poses: Of the probe at those (n,), in ``base``.
    """
    return with_known_speed(detection, poses, speed_of_maps(session), None)


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceGain:
    """Standard deviation of a thickness (RMS) in mm with and without reference points to come."""

    scans: Ints  # (n,) numbers of the A-scans that are proposed for a caliper
    now_mm: float
    then_mm: float


def reference_gain(session: Session, n: int = LEAST_POINTS) -> ReferenceGain | None:
    """Return which n places the program proposes, and what is gained by measuring them.

    The points there are stay. None before step 9, where its detection is stale, or where no n
    places are thick and sure enough.
    """
    if fresh("detection", session) is None:
        return None  # its A-scans may be others than those of the capture
    shares, depths = thickness_shares(session), ECHO_DEPTHS.read(session)
    if shares is None or depths is None:
        return None
    proposal = _proposal(depths, speed_of_maps(session), n)
    if proposal is None:
        return None
    rest = shares.timing_mm**2 + shares.wedge_mm**2
    now_mm, then_mm = (float((rest + by**2) ** 0.5) for by in (proposal.now_mm, proposal.then_mm))
    return ReferenceGain(depths.scans[proposal.rows], now_mm, then_mm)


@remember(4)
def _proposal(
    depths: EchoDepths, known: SpeedCalibration | None, n: int
) -> ReferenceProposal | None:
    try:
        return propose_references(depths, n, known)
    except DegenerateGeometryError:
        return None


@remember(4)
def _shares(
    detection: Detection, maps: Maps, known: SpeedCalibration | None
) -> ThicknessShares | None:
    n = len(detection)
    ok = np.asarray(detection.inner_ok)
    if not ok.any():
        return None
    calibration = uncalibrated() if known is None else known
    depth = detection.thickness_mm[ok]
    patient, place = speed_uncertainty(calibration, maps.outer_points_base[:n][ok])
    wedge = 0.5 * depth * _wedge(maps, maps.outer_points_base[:n][ok]) ** 2
    parts = (detection.thickness_sigma_mm[ok], depth * patient, depth * place, wedge)
    squares = [float(np.mean(part**2)) for part in parts]
    timing, patient_mm, place_mm, wedge_mm = (value**0.5 for value in squares)
    return ThicknessShares(
        sum(squares) ** 0.5, timing, patient_mm, place_mm, wedge_mm, len(calibration)
    )


def _wedge(maps: Maps, points_base: Floats) -> Floats:
    """Return the slope (n,) of the inner boundary against the outer one below points (n, 3)."""
    thickness = np.where(maps.inner.ok, maps.thickness_mm(), np.nan)
    u, v = maps.outer.u_mm, maps.outer.v_mm
    if min(thickness.shape) < 2:
        return np.zeros(len(points_base))
    along_u, along_v = np.gradient(thickness, u, v)
    slope = np.minimum(np.nan_to_num(np.hypot(along_u, along_v), nan=0.0), STEEPEST)
    where = maps.outer.T_base_map.inv() @ points_base
    i = np.clip(np.rint((where[:, 0] - u[0]) / (u[1] - u[0])), 0, len(u) - 1).astype(np.int64)
    j = np.clip(np.rint((where[:, 1] - v[0]) / (v[1] - v[0])), 0, len(v) - 1).astype(np.int64)
    return slope[i, j]


__all__ = [
    "ExpectedPerformance",
    "WhatIf",
]
PUBLISHED_WORDS = f"± {100 * PATIENTS_SHARE:.0f} % between studies and patients"
EDITABLE = ("centre_mhz", "bandwidth", "aperture_mm", "line_length_mm", "pulse_shape")


@dataclass(frozen=True, slots=True)
class ReferenceRow:
    """One reference point: thickness by caliper, and by ultrasound at the mean speed."""

    number: int
    caliper_mm: float
    off_mm: float | None  # thickness by the patient's mean speed less the caliper's
    speed_mm_per_us: float | None  # what this point alone says
    counts: bool  # False: it disagrees with the others and hardly counts


def probe_values(settings: ProbeSettings) -> dict[str, Any]:
    """Return the editable values of a probe as they are in effect."""
    model = probe_model(settings)
    return {
        "centre_mhz": model.centre_mhz,
        "bandwidth": model.bandwidth,
        "aperture_mm": 2.0 * model.aperture_radius_mm,
        "line_length_mm": model.line_length_mm,
        "pulse_shape": model.pulse_shape,
    }


def edited_probe(settings: ProbeSettings, values: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of ``SetProbe``: what is as the named probe has it becomes None."""
    named = probe_values(ProbeSettings(name=settings.name))
    changed = {
        name: None if _same(value, named[name]) else value
        for name, value in values.items()
        if name in EDITABLE
    }
    held = {part.name: getattr(settings, part.name) for part in fields(settings)}
    return {**held, **values, **changed}


def _same(a: Any, b: Any) -> bool:
    return a == b if isinstance(a, str) or isinstance(b, str) else abs(a - b) < 1e-6


@lru_cache(maxsize=16)
def probe_performances(settings: ProbeSettings) -> tuple[ExpectedPerformance, ...]:
    """Return what each probe and excitation promises with the settings of this session."""
    return expected_performances(replace(settings, pitch_mm=1.0, line_temperature_c=22.0))


def line_words(session: Session) -> str:
    """Return what is known of the delay line, and whether it is used; empty if not calibrated."""
    held = session.results.line
    if held is None:
        return ""
    line = held.value
    temperature = session.setup.devices.probe.line_temperature_c
    delay_us, sigma_us = line.at(temperature)
    nominal = probe_model(session.setup.devices.probe).line_delay_us
    words = (
        f"Line: {delay_us:.3f} ± {sigma_us:.3f} µs at {temperature:.0f} °C "
        f"(nominal {nominal:.3f} µs), {line.n_used} A-scans"
    )
    return judge_part("line", session).beside(words)


def speed_words(session: Session) -> str:
    """Return what is known of the speed of sound, and whether it is used; else empty."""
    held = session.results.speed
    if held is None:
        return ""
    speed = held.value
    words = (
        f"{speed.speed_mm_per_us:.3f} ± {speed.sigma_mm_per_us:.3f} mm/µs "
        f"(± {100 * speed.share:.1f} %), places differ by ± {speed.local_sd_mm_per_us:.3f}"
    )
    return judge_part("speed", session).beside(words)


def loss_words(detection: Detection) -> str:
    """Return the loss of the bone that echoes were judged by, beside the published mean."""
    published = f"published mean of {NOMINAL_LOSS_DB_PER_CM:.1f}"
    loss = detection.bone_loss
    if not has_inner_echoes(detection):
        return (
            f"Bone loss: not learned, too few sure inner echoes, so no pass counts; {published} "
            "dB/cm at 1 MHz taken."
        )
    if loss is None:
        return f"Bone loss: not learned, too few deep echoes; {published} dB/cm at 1 MHz taken."
    return (
        f"Bone loss: {loss * NOMINAL_LOSS_DB_PER_CM:.1f} dB/cm at 1 MHz ± {100 * MORE_LOSS:.0f} %, "
        f"learned from the echoes: {loss:.1f} times the {published}."
    )


def gain_words(gain: ReferenceGain) -> str:
    """Return what reference points at the proposed places promise, before they are measured."""
    places = ", ".join(str(scan) for scan in gain.scans)
    n = len(gain.scans)
    return (
        f"Thickness ± {gain.now_mm:.2f} mm now, ± {gain.then_mm:.2f} mm with {n} "
        f"reference point{'s' * (n > 1)} at the proposed places (A-scan {places})."
    )


def reference_rows(session: Session) -> tuple[ReferenceRow, ...]:
    """Return the reference points, with what the calibration says of each where it is fresh."""
    points, held = session.captures.references, session.results.speed
    if points is None:
        return ()
    fresh = held is not None and stale_reason("speed", session) is None
    speed = held.value if held is not None and fresh else None
    return tuple(
        ReferenceRow(
            number=i,
            caliper_mm=float(points.thickness_mm[i]),
            off_mm=None if speed is None else float(speed.residuals_mm[i]),
            speed_mm_per_us=None if speed is None else float(speed.point_speeds_mm_per_us[i]),
            counts=True if speed is None else bool(speed.weights[i] >= 0.5),
        )
        for i in range(len(points.thickness_mm))
    )
