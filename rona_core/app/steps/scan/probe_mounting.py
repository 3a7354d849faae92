"""The robot's probe on a gauge plate: recorded before a scan, and used wherever it is known."""

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import capture_setup_digest
from rona_core.app.runtime.handling import compute_result
from rona_core.app.runtime.recording import begin
from rona_core.app.steps.scan.messages import CalibrateProbeMounting, StartProbeMountingCapture
from rona_core.app.steps.scan.mounting_derivation import GaugeCapture
from rona_core.devices.samples import AScanTrack
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import readonly
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.probe_mounting import (
    ProbeMounting,
)
from rona_core.ultrasound.probe.probe_model import probe_model

DEPTHS_MM = (0.3, 0.6, 0.9, 1.2)  # of the gauge plate; a scan at 3 N presses by 1.5 mm


def capture_gauge(
    activity: StartProbeMountingCapture, session: Session, context: ActivityContext
) -> GaugeCapture:
    """Record A-scans on the gauge plate, a track for each depth."""
    probe = session.setup.devices.probe
    ordinal = begin(session, context)
    tracks: list[AScanTrack] = []
    sigma_mm = 0.0
    for number, depth_mm in enumerate(DEPTHS_MM):
        if context.cancel():
            raise CancelledError("the A-scans on the gauge plate were cancelled")
        track, sigma_mm = context.rig.bench.record_gauge_plate(probe, depth_mm, activity.n)
        tracks.append(track)
        context.progress((number + 1) / len(DEPTHS_MM))
    return GaugeCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest("gauge", session),
        tracks=tuple(tracks),
        depths_mm=readonly(np.array(DEPTHS_MM)),
        sigma_mm=sigma_mm,
    )


def calibrate_probe_mounting(message: CalibrateProbeMounting, session: Session) -> Session:
    """Carry out `CalibrateProbeMounting`."""
    if message.use:
        return compute_result(message, session)
    return session.with_result("mounting", None)


def mounting_words(session: Session) -> str:
    """Return what is known of the probe's mounting, and whether it is used; empty if it is not."""
    held = session.results.get("mounting")
    if held is None:
        return ""
    found: ProbeMounting = held.value
    shift_mm = found.shift_mm(probe_model(session.setup.devices.probe))
    words = (
        f"Outer boundary {shift_mm:+.2f} mm (outward) against a probe as drawn, by its mounting "
        f"and its line together, ± {found.sigma_mm:.2f} mm"
    )
    return judge_part("mounting", session).beside(words)
