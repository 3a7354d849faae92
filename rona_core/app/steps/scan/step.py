"""Scan: the robot executes the certified plan, the probe records A-scans."""

from dataclasses import replace

from rona_core.app.declarations.declarations import (
    Activity,
    ActivityContext,
    Capture,
    Message,
    Step,
    StepLine,
)
from rona_core.app.dependencies.inputs import capture_input, result_input
from rona_core.app.dependencies.staleness import session_obstacles, stale_reason
from rona_core.app.runtime.recording import ARRIVAL_S, begin, finish
from rona_core.app.steps.roll.plan_reasons import plan_reason
from rona_core.app.steps.scan.captures import record_scan
from rona_core.app.steps.scan.messages import StartRetract, StartScan
from rona_core.app.steps.scan.planned_motion import planned_scans
from rona_core.app.steps.setup.capture_parts import (
    bone_and_probe_part,
    contact_part,
    input_part,
    robot_errors_part,
    robot_part,
    specimen_part,
)
from rona_core.app.steps.tool.robot_motion import FreeMoves
from rona_core.errors import CancelledError
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session


def draw_probe_back(session: Session, tools: ActivityContext) -> None:
    """Draw the probe back along its axis from where it stands, certified first.

    Raises:
        StepBlockedError: it stands clear of everything.
        NotReachableError: the joints or something in the way do not allow it; it says why.
        CancelledError: somebody pressed Cancel or Stop on the way.
    """
    model = robot_model(session.setup.devices.robot.model)
    begin(session, tools)
    clock = tools.rig.clock
    clock.wait_until(clock.now() + ARRIVAL_S)  # until it is known where it came to rest
    moves = FreeMoves(model, session_obstacles(session))
    line = moves.back(tools.rig.robot.state().q_rad)
    if not finish(tools.rig.robot.move(line.times_s, line.qs_rad), tools):
        raise CancelledError("the robot was stopped while it drew the probe back: retract again")


def retract(
    activity: StartRetract, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `StartRetract`; the session stays as it is."""
    draw_probe_back(session, context)
    return ()


SCAN_CAPTURE, ROLL = capture_input("scan"), result_input("roll")


def _not_to_be_driven(session: Session) -> str | None:
    """Return why a plan that is fresh cannot be driven."""
    return None if stale_reason("roll", session) else plan_reason(session)


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
    return "" if scan is None else _partial(session) or f"{len(scan.scans)} A-scans"


STEP = Step(
    "scan",
    activities=(
        Activity(
            StartScan,
            record_scan,
            "Scanning",
            needs=(ROLL,),
            blocked=_not_to_be_driven,
            uses_devices=True,
            drives_robot=True,
            records=True,
        ),
        Activity(
            StartRetract,
            retract,
            "Drawing the probe back",
            uses_devices=True,
            drives_robot=True,
        ),
    ),
    captures=(
        Capture(
            "scan",
            "scan (step 8)",
            (
                robot_part,
                robot_errors_part,
                specimen_part,
                bone_and_probe_part,
                input_part(ROLL),
                contact_part,
            ),
            after=ROLL,
            stored=_forget_corrections,
        ),
    ),
    line=StepLine(
        "Scan",
        _summary,
        StartScan,
        leaves=lambda session: (SCAN_CAPTURE,),
        partial=_partial,
    ),
)
