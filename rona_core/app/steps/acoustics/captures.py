"""Captures for the acoustic calibration: caliper and steel block; a sweep over virtual plates."""

import numpy as np

from rona_core.app.declarations.activity_context import ActivityContext
from rona_core.app.declarations.declarations import Message
from rona_core.app.dependencies.capture_setup import capture_setup_digest
from rona_core.app.dependencies.requirements import require_inputs
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.messages.outcomes import StoreCapture, StoreResult
from rona_core.app.messages.serialization import serialize_arguments
from rona_core.app.runtime.recording import begin
from rona_core.app.steps.acoustics.derivation import entry_points
from rona_core.app.steps.acoustics.messages import (
    CalibrateDelayLine,
    CalibrateSoundSpeed,
    StartCaliperMeasurements,
    StartDelayLineCapture,
    StartProbeSweep,
)
from rona_core.app.steps.scan.probe_poses import probe_poses_of
from rona_core.errors import CancelledError, StepBlockedError
from rona_core.geometry.arrays import readonly
from rona_core.session.captures import BlockCapture, ReferenceCapture
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.expected_performance import WhatIfGrid
from rona_core.ultrasound.acoustic_calibration.reference_points import choose_reference_scans


def record_thickness(
    activity: StartCaliperMeasurements, session: Session, tools: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `StartCaliperMeasurements`."""
    require_inputs(type(activity), session)
    detection, poses = session.results.detection, probe_poses_of(session)
    if detection is None or poses is None or stale_reason("detection", session) is not None:
        raise StepBlockedError(
            "StartCaliperMeasurements is blocked: map the boundaries first (step 9)"
        )
    places = entry_points(session, detection.value)
    rows = choose_reference_scans(places, detection.value, activity.n)
    ordinal = begin(session, tools)
    axes = poses.rotations[rows][:, :, 2]
    thickness_mm, sigma_mm = tools.rig.bench.measure_thickness(places[rows], axes)
    capture = ReferenceCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest("references", session),
        places_base=readonly(places[rows]),
        thickness_mm=readonly(thickness_mm),
        sigma_mm=readonly(np.full(len(rows), sigma_mm)),
    )
    return (StoreCapture("references", capture, activity.append), CalibrateSoundSpeed())


def record_block(
    activity: StartDelayLineCapture, session: Session, tools: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `StartDelayLineCapture`."""
    probe = session.setup.devices.probe
    ordinal = begin(session, tools)
    temperatures = activity.temperatures_c or (probe.line_temperature_c,)
    tracks = []
    for number, temperature_c in enumerate(temperatures):
        if tools.cancel():
            raise CancelledError("the A-scans on the block were cancelled")
        tracks.append(tools.rig.bench.record_reference_block(probe, temperature_c, activity.n))
        tools.progress((number + 1) / len(temperatures))
    capture = BlockCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest("block", session),
        tracks=tuple(tracks),
        temperatures_c=readonly(np.array(temperatures, dtype=np.float64)),
    )
    return (StoreCapture("block", capture), CalibrateDelayLine())


def sweep_probes(
    activity: StartProbeSweep, session: Session, tools: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `StartProbeSweep`."""
    if tools.sweep is None:
        raise StepBlockedError(
            "StartProbeSweep is blocked: there are no virtual plates to try it on"
        )
    grid = WhatIfGrid(
        probes=activity.probes,
        excitations=activity.excitations,
        snr_db=activity.snr_db,
        thickness_mm=activity.thickness_mm,
        kind=activity.bone,
        n=activity.n,
    )
    values = {"what_if": tools.run(tools.sweep, grid)}
    by, inputs = type(activity).__name__, {"what_if": dict[str, str]()}  # it depends on no session
    return (StoreResult(by, values, serialize_arguments(activity), inputs),)
