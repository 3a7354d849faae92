"""Handheld: the tracked probe in the hand, calibrated, scanned and mapped without a robot."""

from dataclasses import replace

import numpy as np

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Message, Remedy
from rona_core.app.dependencies.judge import by_verdict
from rona_core.app.dependencies.staleness import capture_setup_digest
from rona_core.app.messages.message import StoreCapture
from rona_core.app.runtime.handling import (
    begin,
    capture_hand,
    compute,
    compute_result,
    part_of,
    record,
)
from rona_core.app.steps.handheld import messages
from rona_core.app.steps.handheld.derivation import (
    CALIBRATION,
    PIVOT,
    SCAN,
    SPIN,
    calibrate_held_probe,
    find_boundaries_by_hand,
    map_scan_by_hand,
)
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.devices.samples import AScan, AScanTrack, ToolTrack, TrackerFrame
from rona_core.devices.settings import SONO
from rona_core.errors import CancelledError
from rona_core.session.captures import SonoCapture
from rona_core.session.document import Session

PIVOT_SHARE = 0.5  # of the time of a calibration, for the progress


def record_calibration(
    activity: messages.StartHandheldCalibration, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record pivoting and turning of the hand-held probe, then calibrate it.

    What was cut short is stored all the same; nothing follows it.
    """
    operator = context.rig.operator

    def pivot() -> float:
        operator.hold(SONO)
        return operator.pivot(cone_deg=activity.cone_deg, duration_s=activity.pivot_s)

    def spin() -> float:
        operator.hold(SONO)
        return operator.spin(half_turn_deg=activity.half_turn_deg, duration_s=activity.spin_s)

    part = part_of(context, 0.0, PIVOT_SHARE)
    first = capture_hand("sono_pivot", session, part, pivot, tool=SONO)
    if first.partial:
        return (StoreCapture("sono_pivot", first),)
    session = replace(session, archive=(*session.archive, first))  # the next ordinal
    part = part_of(context, PIVOT_SHARE, 1.0 - PIVOT_SHARE)
    second = capture_hand("sono_spin", session, part, spin, tool=SONO)
    first = replace(first, partial=second.partial)  # the two count together
    stored = (StoreCapture("sono_pivot", first), StoreCapture("sono_spin", second))
    return stored if second.partial else (*stored, messages.CalibrateHandheldProbe())


def capture_sono_scan(
    activity: messages.StartHandheldScan, session: Session, context: ActivityContext
) -> SonoCapture:
    """Record the marker on the probe and its A-scans while it slides over the region."""
    ordinal = begin(session, context)
    rig = context.rig
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
        if context.cancel():
            partial = True
            break
        rig.clock.wait_until(float(time_s))
        if fire:
            scans.append(rig.probe.acquire())
            context.live.put(ascan=scans[-1], n_scans=len(scans))
            context.progress(len(scans) / len(fire_s))
            continue
        frame = rig.tracker.latest()
        if not frames or frame.number > frames[-1].number:
            frames.append(frame)
            context.live.put(frame=frame)
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


def _forget_corrections(before: Session, after: Session) -> Session:
    """Return ``after`` without the corrections of boundaries in the scan by hand before."""
    return replace(after, boundary_edits=before.boundary_edits.without("hand"))


STEP = declare.Step(
    "handheld",
    commands=(
        declare.Command(messages.CalibrateHandheldProbe, compute_result, needs=(PIVOT, SPIN)),
    ),
    activities=(
        declare.Activity(
            messages.StartHandheldCalibration,
            record_calibration,
            "Calibrating the SonoPointer",
            makes=("sono_pivot", "sono_spin"),
        ),
        declare.Activity(
            messages.StartHandheldScan,
            record("sono_scan", capture_sono_scan),
            "Scanning by hand",
            needs=(CALIBRATION,),
            makes=("sono_scan",),
        ),
        declare.Activity(
            messages.StartHandheldMapping,
            compute,
            "Mapping the scan by hand",
            needs=(SCAN, CALIBRATION),
        ),
    ),
    captures=(
        declare.Capture(
            "sono_pivot",
            "pivot the SonoPointer (step 9)",
            (parts.tracker,),
            done="the pivoting of the SonoPointer was recorded",
        ),
        declare.Capture(
            "sono_spin",
            "turn the SonoPointer about its axis",
            (parts.tracker,),
            done="the turning of the SonoPointer was recorded",
        ),
        declare.Capture(
            "sono_scan",
            "scan by hand (step 9)",
            (parts.tracker, parts.robot, parts.specimen, parts.bone_and_hand_probe, parts.HEAD),
            stored=_forget_corrections,
            done="the scan by hand was recorded",
        ),
    ),
    results=(
        declare.Result.of(
            "sono",
            messages.CalibrateHandheldProbe,
            calibrate_held_probe,
            "calibrate the SonoPointer (step 9)",
            judged=by_verdict(
                Remedy(
                    "calibrate the SonoPointer again (step 9)", messages.StartHandheldCalibration()
                ),
                used=True,
            ),
            done="the calibration of the SonoPointer was computed",
        ),
        declare.Result.of(
            "sono_detection",
            messages.StartHandheldMapping,
            find_boundaries_by_hand,
            "map the scan by hand",
            settings=("method", "sound_speed_mm_per_us"),
            done="the boundaries of the scan by hand were detected",
        ),
        declare.Result.of(
            "sono_maps",
            messages.StartHandheldMapping,
            map_scan_by_hand,
            "map the scan by hand",
            settings=("sound_speed_mm_per_us", "cell_mm"),
            done="the maps of the scan by hand were computed",
        ),
    ),
    part_of="maps",
)
