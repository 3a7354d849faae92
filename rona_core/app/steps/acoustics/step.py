"""Acoustics: delay line, speed of sound, and what other probes would do."""

from dataclasses import replace

import numpy as np

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Message, Remedy
from rona_core.app.dependencies.judge import by_verdict
from rona_core.app.dependencies.staleness import capture_setup_digest, required, stale_reason
from rona_core.app.runtime.handling import begin, compute_result, computed, record
from rona_core.app.steps.acoustics import messages
from rona_core.app.steps.acoustics.derivation import (
    BLOCK,
    DETECTION,
    ECHO_DEPTHS,
    KNOWN_SPEED,
    REFERENCES,
    compare_with_caliper,
    find_line_delay,
    require_point,
)
from rona_core.app.steps.scan.derivation import POSES, SCAN
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.setup.capture_parts import BLOCK_PROBE
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.errors import CancelledError, InvalidInputError, StepBlockedError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.mapping.build_maps import boundary_points
from rona_core.session.captures import BlockCapture, ReferenceCapture
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.expected_performance import WhatIfGrid
from rona_core.ultrasound.acoustic_calibration.reference_points import propose_references
from rona_core.ultrasound.detection.detect import Detection


def entry_points(session: Session, detection: Detection) -> Floats:
    """Return where the probe's axis enters the bone (n, 3) at each A-scan, in ``base``."""
    return boundary_points(detection, required(POSES, session))[0]


def capture_thickness(
    activity: messages.StartCaliperMeasurements, session: Session, context: ActivityContext
) -> ReferenceCapture:
    """Measure the thickness at well-chosen places of the scan with a caliper."""
    depths = required(ECHO_DEPTHS, session)
    known = KNOWN_SPEED.read(session) if activity.append else None
    rows = propose_references(depths, activity.n, known).rows
    ordinal = begin(session, context)
    places, axes = depths.places_base[rows], depths.axes_base[rows]
    thickness_mm, sigma_mm = context.rig.bench.measure_thickness(places, axes)
    return ReferenceCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest("references", session),
        places_base=readonly(places),
        thickness_mm=readonly(thickness_mm),
        sigma_mm=readonly(np.full(len(rows), sigma_mm)),
    )


def capture_block(
    activity: messages.StartDelayLineCapture, session: Session, context: ActivityContext
) -> BlockCapture:
    """Record A-scans on the reference block, a track for each temperature of the delay line."""
    probe = session.setup.devices.probe
    ordinal = begin(session, context)
    temperatures = activity.temperatures_c or (probe.line_temperature_c,)
    tracks = []
    for number, temperature_c in enumerate(temperatures):
        if context.cancel():
            raise CancelledError("the A-scans on the block were cancelled")
        tracks.append(context.rig.bench.record_reference_block(probe, temperature_c, activity.n))
        context.progress((number + 1) / len(temperatures))
    return BlockCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest("block", session),
        tracks=tuple(tracks),
        temperatures_c=readonly(np.array(temperatures, dtype=np.float64)),
    )


def sweep_probes(
    activity: messages.StartProbeSweep, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `StartProbeSweep`."""
    if context.sweep is None:
        raise StepBlockedError("there are no virtual plates to try it on")
    grid = WhatIfGrid(
        probes=activity.probes,
        excitations=activity.excitations,
        snr_db=activity.snr_db,
        thickness_mm=activity.thickness_mm,
        kind=activity.bone,
        n=activity.n,
    )
    return computed(activity, {"what_if": context.run(context.sweep, grid)}, session)


def add_reference_point(message: messages.AddReferencePoint, session: Session) -> Session:
    """Carry out `AddReferencePoint`."""
    place = np.array(message.place_base_mm or (0.0, 0.0, 0.0))
    if message.scan is not None:
        detection = required(DETECTION, session)
        if stale_reason("detection", session) is not None:
            raise StepBlockedError("map the boundaries again first")
        require_point(detection, message.scan)
        place = entry_points(session, detection)[message.scan]
    held = _held(session)
    points = 0 if held is None else len(held.thickness_mm)
    if points >= messages.MAX_POINTS:
        raise InvalidInputError(f"at most {messages.MAX_POINTS} reference points, please")
    one = ReferenceCapture(
        0 if held is None else held.ordinal,
        capture_setup_digest("references", session),
        readonly(place[None, :].astype(np.float64)),
        readonly(np.array([float(message.thickness_mm)])),
        readonly(np.array([float(message.sigma_mm)])),
    )
    return session.with_capture("references", one if held is None else joined(held, one))


def remove_reference_point(message: messages.RemoveReferencePoint, session: Session) -> Session:
    """Carry out `RemoveReferencePoint`."""
    held = session.captures.references
    if held is None:
        raise InvalidInputError("there is no reference point to remove")
    n = len(held.thickness_mm)
    if message.index is None or n == 1:
        if message.index not in (None, 0):
            raise InvalidInputError("there is 1 reference point, numbered 0")
        return session.with_capture("references", None)
    if message.index >= n:
        raise InvalidInputError(f"there are {n} reference points, numbered from 0")
    kept = np.arange(n) != message.index
    left = replace(
        held,
        places_base=readonly(held.places_base[kept]),
        thickness_mm=readonly(held.thickness_mm[kept]),
        sigma_mm=readonly(held.sigma_mm[kept]),
    )
    return session.with_capture("references", left)


def calibrate_delay_line(message: messages.CalibrateDelayLine, session: Session) -> Session:
    """Carry out `CalibrateDelayLine`."""
    if message.use:
        return compute_result(message, session)
    return session.with_result("line", None)


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


STEP = declare.Step(
    "acoustics",
    commands=(
        declare.Command(
            messages.AddReferencePoint, add_reference_point, done="a reference point was added"
        ),
        declare.Command(
            messages.RemoveReferencePoint,
            remove_reference_point,
            done="the reference points were removed",
        ),
        declare.Command(
            messages.CalibrateSoundSpeed, compute_result, needs=(REFERENCES, DETECTION)
        ),
        declare.Command(messages.CalibrateDelayLine, calibrate_delay_line, needs=(BLOCK,)),
    ),
    activities=(
        declare.Activity(
            messages.StartCaliperMeasurements,
            record("references", capture_thickness, messages.CalibrateSoundSpeed),
            "Measuring with a caliper",
            needs=(SCAN, DETECTION),
            makes=("references",),
            shown_in="maps",
        ),
        declare.Activity(
            messages.StartDelayLineCapture,
            record("block", capture_block, messages.CalibrateDelayLine),
            "Recording on the reference block",
            makes=("block",),
            shown_in="setup",
        ),
        declare.Activity(
            messages.StartProbeSweep, sweep_probes, "Comparing probes", shown_in="setup"
        ),
    ),
    captures=(
        declare.Capture(
            "block",
            "take A-scans on the block (step 1)",
            (parts.of_input(BLOCK_PROBE, SetProbe.__name__), parts.BLOCK),
            done="the A-scans on the block were recorded",
        ),
        declare.Capture(
            "references",
            "measure reference points (step 9)",
            (parts.robot, parts.specimen),
            place=place_references,
            done="the reference points were measured",
        ),
    ),
    results=(
        declare.Result.of(
            "line",
            messages.CalibrateDelayLine,
            find_line_delay,
            "calibrate the delay line (step 1)",
            judged=by_verdict(
                Remedy("take A-scans on the block again (step 1)", messages.StartDelayLineCapture())
            ),
            done="the calibration of the delay line was computed",
        ),
        declare.Result.of(
            "speed",
            messages.CalibrateSoundSpeed,
            compare_with_caliper,
            "calibrate the speed (step 9)",
            judged=by_verdict(
                Remedy(
                    "measure more reference points (step 9)",
                    messages.StartCaliperMeasurements(append=True),
                )
            ),
            done="the calibration of the speed of sound was computed",
        ),
        declare.Result(
            "what_if",
            messages.StartProbeSweep,
            {},
            "compare probes (step 1)",
            done="the probes were compared on plates",
        ),
    ),
)
