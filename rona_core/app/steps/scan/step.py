"""Scan: the robot executes the certified plan, after a quick look with each probe by hand."""

from dataclasses import replace

import numpy as np

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Message, Remedy
from rona_core.app.dependencies.judge import by_verdict, fresh, judge_part
from rona_core.app.dependencies.staleness import (
    capture_input,
    capture_setup_digest,
    required,
    result_input,
    session_obstacles,
)
from rona_core.app.messages.message import StoreCapture
from rona_core.app.runtime.handling import (
    ARRIVAL_S,
    begin,
    compute_result,
    computed,
    derive_all,
    finish,
    part_of,
    record,
    strip_for_worker,
)
from rona_core.app.steps.path.inputs import SMOOTHING
from rona_core.app.steps.scan.captures import capture_scan
from rona_core.app.steps.scan.derivation import (
    GAUGE,
    GaugeCapture,
    LookCapture,
    compare_probes,
    find_mounting,
)
from rona_core.app.steps.scan.landmarks.step import LANDMARKS, verified_first
from rona_core.app.steps.scan.messages import (
    CalibrateProbeMounting,
    StartHome,
    StartProbeMountingCapture,
    StartQuickLook,
    StartRetract,
    StartScan,
)
from rona_core.app.steps.scan.planned_motion import planned_scans
from rona_core.app.steps.scan.view import unwatched
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.setup.capture_parts import BLOCK_PROBE, LOOK_PROBES
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.app.steps.tool.robot_motion import FreeMoves, drive_to, same_place
from rona_core.devices.samples import AScanTrack
from rona_core.errors import CancelledError, StepBlockedError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.mapping.tilted_passes import TiltSettings, tilted_paths
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.probe_mounting import ProbeMounting
from rona_core.ultrasound.detection.probe_choice import ProbeAdvice, advise
from rona_core.ultrasound.probe.probe_model import probe_model

SHOTS = 5  # A-scans of a line
PITCH_MM = 1.0
RECORDING_SHARE = 0.5  # of the time of a quick look
DEPTH_MM = 1.0  # by which the collar presses the line of the probe


def take_quick_look(
    activity: StartQuickLook, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `StartQuickLook`."""
    taken = capture_looks(activity, session, part_of(context, 0.0, RECORDING_SHARE))
    looked = session.with_capture("looks", taken)
    part = part_of(context, RECORDING_SHARE, 1.0 - RECORDING_SHARE)
    values = part.run(derive_all, strip_for_worker(looked), activity)
    return (StoreCapture("looks", taken), *computed(activity, values, looked))


def capture_looks(
    activity: StartQuickLook, session: Session, context: ActivityContext
) -> LookCapture:
    """Record short lines over the path with each probe, upright and tilted.

    Raises:
        CancelledError: Cancel or Stop was pressed: half a look says nothing.
    """
    path = required(SMOOTHING, session).path
    rows = line_rows(path, activity.lines)
    ways = (path, *(one.path for one in tilted_paths(path, TiltSettings())))
    places, axes = path.points_base[rows], np.array([one.axes_base[rows] for one in ways])
    ordinal = begin(session, context)
    probes = required(LOOK_PROBES, session)
    tracks: list[AScanTrack] = []
    for probe in probes:
        for towards in axes:
            if context.cancel():
                raise CancelledError("the quick look was cancelled: nothing of it is kept")
            tracks.append(context.rig.bench.record_on_bone(probe, places, towards, DEPTH_MM))
            context.progress(len(tracks) / (len(probes) * len(axes)))
    return LookCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest("looks", session),
        probes=probes,
        tracks=tuple(tracks),
        places_base=readonly(places),
        axes_base=readonly(axes),
        lines=activity.lines,
        depth_mm=DEPTH_MM,
    )


def line_rows(path: Path5D, lines: int) -> Ints:
    """Return the points (lines * ``SHOTS``) of a path that are nearest to short lines along it.

    The lines are spread evenly over the path; each follows it.
    """
    way_mm = path.arc_length_mm()
    middles = np.linspace(0.0, way_mm[-1], lines + 2)[1:-1]
    wanted = middles[:, None] + PITCH_MM * (np.arange(SHOTS) - SHOTS // 2)
    return np.abs(way_mm - wanted.reshape(-1, 1)).argmin(axis=1)


def probe_advice(session: Session) -> ProbeAdvice | None:
    """Return what the quick look says about the probe; None without one, or where it is stale."""
    look = fresh("quick_look", session)
    if look is None:
        return None
    advice = advise(look, session.setup.devices.probe.name)
    if not advice.another:
        return advice
    words = "Choose it in step 1" + (" and scan again." if session.captures.scan else ".")
    return replace(advice, sentence=f"{advice.sentence} {words}")


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


SCAN_CAPTURE, ROLL = capture_input("scan"), result_input("roll")


def retract(
    activity: StartRetract, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Draw the probe back along its axis from where it stands, certified first.

    Raises:
        StepBlockedError: it stands clear of everything.
        NotReachableError: the joints or something in the way do not allow it; it says why.
        CancelledError: Cancel or Stop was pressed on the way.
    """
    model = robot_model(session.setup.devices.robot.model)
    stood = _where_it_rests(session, context)
    line = FreeMoves(model, session_obstacles(session)).back(stood)
    if not finish(context.rig.robot.move(line.times_s, line.qs_rad), context):
        raise CancelledError("the robot was stopped while it drew the probe back: retract again")
    return ()


def go_home(activity: StartHome, session: Session, context: ActivityContext) -> tuple[Message, ...]:
    """Drive the robot home, the probe drawn back first where it stands on the bone.

    Raises:
        StepBlockedError: it is at home.
        NotReachableError: there is no such motion, or the verifier refuses it; it says why.
        CancelledError: Cancel or Stop was pressed on the way.
    """
    home_rad = robot_model(session.setup.devices.robot.model).home_rad
    if same_place(_where_it_rests(session, context), home_rad):
        raise StepBlockedError("the robot is at home")
    drive_to(home_rad, session, context)
    return ()


def _where_it_rests(session: Session, context: ActivityContext) -> Floats:
    """Return the joint angles (6,) once it is known where the robot came to rest."""
    begin(session, context)
    clock = context.rig.clock
    clock.wait_until(clock.now() + ARRIVAL_S)
    return context.rig.robot.state().q_rad


def _forget_corrections(before: Session, after: Session) -> Session:
    """Return ``after`` with the corrections of boundaries that are of other A-scans."""
    return replace(after, boundary_edits=before.boundary_edits.of("hand"))


def _partial(session: Session) -> str | None:
    scan = session.captures.scan
    if scan is None or not scan.partial:
        return None
    came = len(scan.scans)
    planned = max(came, planned_scans(session))
    return f"the scan stopped early, after {came} of {planned} A-scans"


def _summary(session: Session) -> str:
    scan = session.captures.scan
    if scan is None:
        return ""
    head = "" if unwatched(session) is None else ", head not watched"
    return _partial(session) or f"{len(scan.scans)} A-scans{head}"


STEP = declare.Step(
    "scan",
    commands=(declare.Command(CalibrateProbeMounting, calibrate_probe_mounting, needs=(GAUGE,)),),
    activities=(
        declare.Activity(
            StartScan,
            verified_first(
                record("scan", lambda _, session, context: capture_scan(session, context))
            ),
            "Scanning",
            needs=(ROLL, LANDMARKS),
            drives_robot=True,
            makes=("scan",),
        ),
        declare.Activity(
            StartProbeMountingCapture,
            record("gauge", capture_gauge, CalibrateProbeMounting),
            "Pressing the probe on the gauge plate",
            makes=("gauge",),
        ),
        declare.Activity(
            StartQuickLook,
            take_quick_look,
            "Taking a quick look with each probe",
            needs=(SMOOTHING,),
            makes=("looks",),
        ),
        declare.Activity(
            StartRetract,
            retract,
            "Drawing the probe back",
            drives_robot=True,
        ),
        declare.Activity(StartHome, go_home, "Driving the robot home", drives_robot=True),
    ),
    captures=(
        declare.Capture(
            "scan",
            "scan (step 8)",
            (
                parts.robot,
                parts.robot_errors,
                parts.specimen,
                parts.bone_and_probe,
                parts.of_input(ROLL, "roll", "ChooseRoll"),
                parts.contact,
                parts.CLAMPED_PROBE,
                parts.HEAD,
            ),
            after=ROLL,
            stored=_forget_corrections,
            done="the scan was recorded",
        ),
        declare.Capture(
            "gauge",
            "press the probe on the gauge plate (step 8)",
            (parts.of_input(BLOCK_PROBE, SetProbe.__name__), parts.BLOCK, parts.CLAMPED_PROBE),
            types=(GaugeCapture,),
            done="the A-scans on the gauge plate were recorded",
        ),
        declare.Capture(
            "looks",
            "take a quick look with each probe (step 8)",
            (parts.specimen, parts.bone_and_looks),
            types=(LookCapture,),
            done="the quick look was taken",
        ),
    ),
    results=(
        declare.Result.of(
            "quick_look",
            StartQuickLook,
            compare_probes,
            "compare the probes (step 8)",
            done="the comparison of the probes was computed",
        ),
        declare.Result.of(
            "mounting",
            CalibrateProbeMounting,
            find_mounting,
            "calibrate the mounting of the probe (step 8)",
            judged=by_verdict(
                Remedy(
                    "press the probe on the gauge plate again (step 8)", StartProbeMountingCapture()
                )
            ),
            done="the calibration of the probe mounting was computed",
        ),
    ),
    line=declare.StepLine(
        "Scan",
        _summary,
        StartScan,
        leaves=lambda session: (SCAN_CAPTURE,),
        partial=_partial,
    ),
)
