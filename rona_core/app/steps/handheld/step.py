"""Handheld: the tracked probe in the hand, calibrated, scanned and mapped without a robot."""

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
from rona_core.app.dependencies.base_reference import found_again
from rona_core.app.dependencies.inputs import capture_input, result_input, setup_input
from rona_core.app.dependencies.requirements import require_for
from rona_core.app.dependencies.staleness import capture_setup_digest
from rona_core.app.messages.outcomes import StoreCapture
from rona_core.app.runtime.handling import compute_result, compute_several
from rona_core.app.runtime.recording import begin, capture_hand
from rona_core.app.steps.acoustics.derivation import KNOWN_LINE, KNOWN_SPEED
from rona_core.app.steps.handheld.derivation import (
    derive_sono,
    derive_sono_detection,
    derive_sono_mapping,
    derive_sono_maps,
)
from rona_core.app.steps.handheld.messages import (
    CalibrateHandheldProbe,
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.app.steps.setup.capture_parts import (
    bone_and_hand_probe_part,
    bone_and_probe_part,
    robot_part,
    specimen_part,
    tracker_part,
)
from rona_core.app.steps.setup.inputs import CHOOSE_REFERENCE, HAND_PROBE
from rona_core.devices.samples import AScan, AScanTrack, ToolTrack, TrackerFrame
from rona_core.devices.settings import SONO
from rona_core.errors import CancelledError
from rona_core.session.captures import PointerCapture, SonoCapture
from rona_core.session.document import Session

PIVOT_SHARE = 0.5  # of the time of a calibration, for the progress


def capture_sono_calibration(
    activity: StartHandheldCalibration, session: Session, tools: ActivityContext
) -> tuple[PointerCapture, PointerCapture | None]:
    """Record the pivoting, then the turning; None for the second if the first was cut short."""
    operator = tools.rig.operator

    def pivot() -> float:
        operator.hold(SONO)
        return operator.pivot(cone_deg=activity.cone_deg, duration_s=activity.pivot_s)

    def spin() -> float:
        operator.hold(SONO)
        return operator.spin(half_turn_deg=activity.half_turn_deg, duration_s=activity.spin_s)

    first = capture_hand("sono_pivot", session, _part(tools, 0.0), pivot, tool=SONO)
    if first.partial:
        return first, None
    session = replace(session, archive=(*session.archive, first))  # the next ordinal
    return first, capture_hand("sono_spin", session, _part(tools, PIVOT_SHARE), spin, tool=SONO)


def _part(tools: ActivityContext, start: float) -> ActivityContext:
    """Return the tools with the progress of one half of the calibration."""

    def progress(share: float) -> None:
        tools.progress(start + PIVOT_SHARE * share)

    return replace(tools, progress=progress)


def capture_sono_scan(
    activity: StartHandheldScan, session: Session, tools: ActivityContext
) -> SonoCapture:
    """Record the marker on the probe and its A-scans while it slides over the region."""
    ordinal = begin(session, tools)
    rig = tools.rig
    rig.operator.hold(SONO)
    duration_s = rig.operator.slide_probe(
        spacing_mm=activity.spacing_mm, duration_s=activity.duration_s
    )
    fire_s = np.arange(0.0, duration_s, 1.0 / activity.rate_hz)
    frame_s = np.arange(0.0, duration_s, 1.0 / session.setup.devices.tracker.rate_hz)
    times_s = np.concatenate((frame_s, fire_s))
    fires = np.repeat((False, True), (len(frame_s), len(fire_s)))
    order = np.lexsort((fires, times_s))
    frames: list[TrackerFrame] = []
    scans: list[AScan] = []
    partial = False
    for time_s, fire in zip(times_s[order], fires[order], strict=True):
        if tools.cancel():
            partial = True
            break
        rig.clock.wait_until(float(time_s))
        if fire:
            scans.append(rig.probe.acquire())
            tools.live.put(ascan=scans[-1], n_scans=len(scans))
            tools.progress(len(scans) / len(fire_s))
            continue
        frame = rig.tracker.latest()
        if not frames or frame.number > frames[-1].number:
            frames.append(frame)
            tools.live.put(frame=frame)
    if partial and not scans:
        raise CancelledError("stopped before the probe fired: what was recorded earlier is kept")
    return SonoCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest("sono_scan", session),
        marker=ToolTrack.from_frames(SONO, frames),
        scans=AScanTrack.from_scans(scans),
        partial=partial,
        base=ToolTrack.from_frames("basemarker", frames),
        tracker_place=session.setup.devices.tracker.place,
    )


def record_calibration(
    activity: StartHandheldCalibration, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record pivoting and turning of the hand-held probe, then calibrate it."""
    pivot, spin = capture_sono_calibration(activity, session, context)
    if spin is None:
        return (StoreCapture("sono_pivot", pivot),)
    if spin.partial:  # the two count together
        pivot = replace(pivot, partial=True)
        return (StoreCapture("sono_pivot", pivot), StoreCapture("sono_spin", spin))
    stored = (StoreCapture("sono_pivot", pivot), StoreCapture("sono_spin", spin))
    return (*stored, CalibrateHandheldProbe())


def record_hand_scan(
    activity: StartHandheldScan, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record a scan by hand."""
    require_for(activity, session)
    return (StoreCapture("sono_scan", capture_sono_scan(activity, session, context)),)


PIVOT, SPIN = capture_input("sono_pivot"), capture_input("sono_spin")
SCAN, CALIBRATION = capture_input("sono_scan"), result_input("sono")
ANY_TOOL = result_input("tool", optional=True)
ANY_SURFACE = result_input("surface", optional=True)
EDITS = setup_input(lambda s: s.boundary_edits.of("hand"), "scan by hand (step 9)")
REFERENCE = setup_input(lambda s: found_again(s, (s.captures.sono_scan,)), CHOOSE_REFERENCE)


def _forget_corrections(before: Session, after: Session) -> Session:
    """Return ``after`` without the corrections of boundaries in the scan by hand before."""
    return replace(after, boundary_edits=before.boundary_edits.without("hand"))


STEP = Step(
    "handheld",
    commands=(Command(CalibrateHandheldProbe, compute_result, needs=(PIVOT, SPIN)),),
    activities=(
        Activity(
            StartHandheldCalibration,
            record_calibration,
            "Calibrating the SonoPointer",
            uses_devices=True,
            records=True,
        ),
        Activity(
            StartHandheldScan,
            record_hand_scan,
            "Scanning by hand",
            needs=(CALIBRATION,),
            uses_devices=True,
            records=True,
        ),
        Activity(
            StartHandheldMapping,
            compute_several(derive_sono_mapping),
            "Mapping the scan by hand",
            needs=(SCAN, CALIBRATION),
        ),
    ),
    captures=(
        Capture("sono_pivot", "pivot the SonoPointer (step 9)", (tracker_part,)),
        Capture("sono_spin", "turn the SonoPointer about its axis", (tracker_part,)),
        Capture(
            "sono_scan",
            "scan by hand (step 9)",
            (tracker_part, robot_part, specimen_part, bone_and_hand_probe_part),
            # older files: it depended on the pitch of the probe, too
            earlier_setup=(tracker_part, robot_part, specimen_part, bone_and_probe_part),
            stored=_forget_corrections,
        ),
    ),
    results=(
        Result(
            "sono",
            CalibrateHandheldProbe,
            derive_sono,
            {"pivot": PIVOT, "spin": SPIN},
            "calibrate the SonoPointer (step 9)",
        ),
        Result(
            "sono_detection",
            StartHandheldMapping,
            derive_sono_detection,
            {
                "capture": SCAN,
                "calibration": CALIBRATION,
                "tool": ANY_TOOL,
                "probe": HAND_PROBE,
                "line": KNOWN_LINE,
            },
            "map the scan by hand",
            long=True,
        ),
        Result(
            "sono_maps",
            StartHandheldMapping,
            derive_sono_maps,
            {
                "detection": result_input("sono_detection"),
                "correction by hand": EDITS,
                "calibration": CALIBRATION,
                "capture": SCAN,
                "tool": ANY_TOOL,
                "surface": ANY_SURFACE,
                "reference": REFERENCE,
                "speed": KNOWN_SPEED,
            },
            "map the scan by hand",
            long=True,
        ),
    ),
    part_of="maps",
)
