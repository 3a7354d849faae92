"""Path: the scan path, demonstrated, drawn by rule, and edited by hand."""

from rona_core.app.declarations.declarations import (
    Activity,
    ActivityContext,
    Capture,
    Command,
    Message,
    Result,
    Step,
    StepLine,
)
from rona_core.app.dependencies.base_reference import carried_remark, found_again, placed_reason
from rona_core.app.dependencies.inputs import capture_input, result_input, setup_input
from rona_core.app.dependencies.requirements import require_for
from rona_core.app.dependencies.step_states import stopped_early
from rona_core.app.messages.outcomes import StoreCapture
from rona_core.app.runtime.recording import capture_stroke
from rona_core.app.steps.path.derivation import derive_path, derive_pattern, is_pattern
from rona_core.app.steps.path.handlers import change_path, compute_path
from rona_core.app.steps.path.messages import (
    BuildPath,
    ClearPathEdits,
    DeletePathPoint,
    GenerateScanPattern,
    InsertPathPoint,
    MovePathPoint,
    PinPathSample,
    StartPathCapture,
)
from rona_core.app.steps.setup.capture_parts import (
    pointer_part,
    robot_part,
    specimen_part,
    tracker_part,
)
from rona_core.app.steps.setup.inputs import CHOOSE_REFERENCE, RADIUS
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session


def capture_path(
    activity: StartPathCapture, session: Session, tools: ActivityContext
) -> PointerCapture:
    """Record the pointer marker while the pointer demonstrates the scan path."""
    return capture_stroke(
        "path",
        session,
        tools,
        activity.picks_base_mm,
        activity.duration_s,
        lambda: tools.rig.operator.draw(
            spacing_mm=activity.spacing_mm, duration_s=activity.duration_s
        ),
    )


def record_path(
    activity: StartPathCapture, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record the demonstration, then build the path."""
    require_for(activity, session)
    capture = capture_path(activity, session, context)
    stored = StoreCapture("path", capture)
    return (stored,) if capture.partial else (stored, BuildPath())


PATH_CAPTURE, PATH = capture_input("path"), result_input("path")
TOOL, POINTER, SURFACE = result_input("tool"), result_input("pointer"), result_input("surface")
SMOOTHING = result_input("smoothing")
REFERENCE = setup_input(lambda s: found_again(s, (s.captures.path,)), CHOOSE_REFERENCE)


def _summary(session: Session) -> str:
    held = session.results.path
    if held is None:
        return ""
    strokes = () if session.captures.path is None else (session.captures.path,)
    made = "pattern of " if is_pattern(session) else ""
    remark = "" if made else carried_remark(session, strokes)
    return f"{made}{len(held.value.points_base)} points{remark}"


def _partial(session: Session) -> str | None:
    return None if is_pattern(session) else stopped_early("path", session)


STEP = Step(
    "path",
    commands=(
        Command(BuildPath, compute_path, needs=(PATH_CAPTURE, TOOL, POINTER)),
        Command(GenerateScanPattern, compute_path, needs=(SURFACE,)),
        Command(MovePathPoint, change_path, needs=(SMOOTHING, SURFACE), takes_stale=True),
        Command(InsertPathPoint, change_path, needs=(SMOOTHING, SURFACE), takes_stale=True),
        Command(DeletePathPoint, change_path, needs=(SMOOTHING,), takes_stale=True),
        Command(PinPathSample, change_path, needs=(PATH, SURFACE), takes_stale=True),
        Command(ClearPathEdits, change_path),
    ),
    activities=(
        Activity(
            StartPathCapture,
            record_path,
            "Demonstrating the path",
            needs=(TOOL, POINTER),
            blocked=placed_reason,
            uses_devices=True,
            records=True,
        ),
    ),
    captures=(
        Capture(
            "path",
            "demonstrate the scan path (step 5)",
            (tracker_part, robot_part, pointer_part, specimen_part),
        ),
    ),
    results=(
        Result(
            "path",
            BuildPath,
            derive_path,
            {
                "capture": PATH_CAPTURE,
                "tool": TOOL,
                "pointer": POINTER,
                "reference": REFERENCE,
            },
            "demonstrate the path (step 5)",
        ),
        Result(
            "path",
            GenerateScanPattern,
            derive_pattern,
            {"surface": SURFACE, "region": RADIUS},
            "demonstrate the path (step 5)",
        ),
    ),
    line=StepLine(
        "Path",
        _summary,
        StartPathCapture,
        leaves=lambda session: (PATH,) if is_pattern(session) else (PATH_CAPTURE, PATH),
        partial=_partial,
    ),
)
