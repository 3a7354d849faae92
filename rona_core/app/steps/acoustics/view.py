"""What is shown of probe, delay line, speed of sound and sweep, ready to be written."""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.acoustics.thickness_uncertainty import (
    ReferenceGain,
    ThicknessShares,
    reference_gain,
    thickness_shares,
)
from rona_core.devices.settings import ProbeSettings
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.expected_performance import (
    ExpectedPerformance,
    WhatIf,
    expected_performances,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import PATIENTS_SHARE
from rona_core.ultrasound.detection.detect import (
    NOMINAL_LOSS_DB_PER_CM,
    Detection,
    has_inner_echoes,
)
from rona_core.ultrasound.detection.spatial.detectability import MORE_LOSS
from rona_core.ultrasound.probe.probe_model import probe_model

__all__ = [
    "ExpectedPerformance",
    "ReferenceGain",
    "ThicknessShares",
    "WhatIf",
    "reference_gain",
    "thickness_shares",
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
