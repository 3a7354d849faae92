"""Acoustics: delay line, speed of sound, and what other probes would do."""

from dataclasses import replace

import numpy as np

from rona_core.app.declarations.declarations import (
    Activity,
    ActivityContext,
    Capture,
    Command,
    Message,
    Result,
    Step,
)
from rona_core.app.dependencies.inputs import capture_input, require_result, result_input
from rona_core.app.dependencies.requirements import require_inputs
from rona_core.app.dependencies.staleness import capture_setup_digest, stale_reason
from rona_core.app.messages.outcomes import StoreCapture, StoreResult
from rona_core.app.messages.serialization import serialize_arguments
from rona_core.app.runtime.handling import compute_result
from rona_core.app.runtime.recording import begin
from rona_core.app.steps.acoustics.derivation import (
    derive_line,
    derive_speed,
    entry_points,
    require_point,
)
from rona_core.app.steps.acoustics.messages import (
    MAX_POINTS,
    AddReferencePoint,
    CalibrateDelayLine,
    CalibrateSoundSpeed,
    RemoveReferencePoint,
    StartCaliperMeasurements,
    StartDelayLineCapture,
    StartProbeSweep,
)
from rona_core.app.steps.scan.probe_poses import probe_poses_of
from rona_core.app.steps.setup.capture_parts import input_part, robot_part, specimen_part
from rona_core.app.steps.setup.inputs import BLOCK_PROBE, MODEL
from rona_core.errors import CancelledError, InvalidInputError, StepBlockedError
from rona_core.geometry.arrays import readonly
from rona_core.session.captures import BlockCapture, ReferenceCapture
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.parameter_sweep import WhatIfGrid
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


def add_reference_point(message: AddReferencePoint, session: Session) -> Session:
    """Carry out `AddReferencePoint`."""
    place = np.array(message.place_base_mm or (0.0, 0.0, 0.0))
    if message.scan is not None:
        detection = require_result(session.results.detection, "map the boundaries (step 9)").value
        if stale_reason("detection", session) is not None:
            raise StepBlockedError("AddReferencePoint is blocked: map the boundaries again first")
        require_point(detection, message.scan)
        place = entry_points(session, detection)[message.scan]
    elif np.abs(place).max() > 1e4:
        raise InvalidInputError("place_base_mm must lie within 10 m of the robot base")
    held = _held(session)
    points = 0 if held is None else len(held.thickness_mm)
    if points >= MAX_POINTS:
        raise InvalidInputError(f"at most {MAX_POINTS} reference points, please")
    one = ReferenceCapture(
        0 if held is None else held.ordinal,
        capture_setup_digest("references", session),
        readonly(place[None, :].astype(np.float64)),
        readonly(np.array([float(message.thickness_mm)])),
        readonly(np.array([float(message.sigma_mm)])),
    )
    return _with(session, one if held is None else joined(held, one))


def remove_reference_point(message: RemoveReferencePoint, session: Session) -> Session:
    """Carry out `RemoveReferencePoint`."""
    held = session.captures.references
    if held is None:
        raise InvalidInputError("there is no reference point to remove")
    n = len(held.thickness_mm)
    if message.index is None or n == 1:
        if message.index not in (None, 0):
            raise InvalidInputError("there is 1 reference point, numbered 0")
        return _with(session, None)
    if message.index >= n:
        raise InvalidInputError(f"there are {n} reference points, numbered from 0")
    kept = np.arange(n) != message.index
    return _with(
        session,
        replace(
            held,
            places_base=readonly(held.places_base[kept]),
            thickness_mm=readonly(held.thickness_mm[kept]),
            sigma_mm=readonly(held.sigma_mm[kept]),
        ),
    )


def calibrate_delay_line(message: CalibrateDelayLine, session: Session) -> Session:
    """Carry out `CalibrateDelayLine`."""
    if message.use:
        return compute_result(message, session)
    return replace(session, results=replace(session.results, line=None))


def place_references(session: Session, capture: ReferenceCapture, append: bool) -> object:
    """Return the reference points after a recording, which replaces the earlier ones or adds."""
    held = _held(session) if append else None
    return capture if held is None else joined(held, capture)


def joined(first: ReferenceCapture, more: ReferenceCapture) -> ReferenceCapture:
    """Return the points of both."""
    return ReferenceCapture(
        more.ordinal,
        more.setup_digest,
        readonly(np.vstack((first.places_base, more.places_base))),
        readonly(np.concatenate((first.thickness_mm, more.thickness_mm))),
        readonly(np.concatenate((first.sigma_mm, more.sigma_mm))),
    )


def _held(session: Session) -> ReferenceCapture | None:
    """Return the points so far; those of another head are left behind."""
    held = session.captures.references
    return None if held is None or stale_reason("capture references", session) else held


def _with(session: Session, references: ReferenceCapture | None) -> Session:
    return replace(session, captures=replace(session.captures, references=references))


BLOCK, REFERENCES = capture_input("block"), capture_input("references")
SCAN_CAPTURE, DETECTION = capture_input("scan"), result_input("detection")

STEP = Step(
    "acoustics",
    commands=(
        Command(AddReferencePoint, add_reference_point),
        Command(RemoveReferencePoint, remove_reference_point),
        Command(CalibrateSoundSpeed, compute_result, needs=(REFERENCES, DETECTION)),
        Command(CalibrateDelayLine, calibrate_delay_line, needs=(BLOCK,)),
    ),
    activities=(
        Activity(
            StartCaliperMeasurements,
            record_thickness,
            "Measuring with a caliper",
            needs=(SCAN_CAPTURE, DETECTION),
            uses_devices=True,
            records=True,
            shown_in="maps",
        ),
        Activity(
            StartDelayLineCapture,
            record_block,
            "Recording on the reference block",
            uses_devices=True,
            records=True,
            shown_in="setup",
        ),
        Activity(StartProbeSweep, sweep_probes, "Comparing probes", shown_in="setup"),
    ),
    captures=(
        Capture("block", "take A-scans on the block (step 1)", (input_part(BLOCK_PROBE),)),
        Capture(
            "references",
            "measure reference points (step 9)",
            (robot_part, specimen_part),
            place=place_references,
        ),
    ),
    results=(
        Result(
            "line",
            CalibrateDelayLine,
            derive_line,
            {"block": BLOCK, "probe": BLOCK_PROBE},
            "calibrate the delay line (step 1)",
        ),
        Result(
            "speed",
            CalibrateSoundSpeed,
            derive_speed,
            {
                "references": REFERENCES,
                "detection": DETECTION,
                "capture": SCAN_CAPTURE,
                "robot": MODEL,
            },
            "calibrate the speed (step 9)",
        ),
        Result("what_if", StartProbeSweep, None, {}, "compare probes (step 1)"),
    ),
)
