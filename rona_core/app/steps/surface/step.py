"""Surface: point cloud of the skull, and where a loaded skull lies under it."""

from dataclasses import replace

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
from rona_core.app.runtime.handling import compute_one, compute_result
from rona_core.app.runtime.recording import capture_stroke
from rona_core.app.steps.setup.capture_parts import (
    pointer_part,
    robot_part,
    specimen_part,
    tracker_part,
)
from rona_core.app.steps.setup.inputs import CHOOSE_REFERENCE, REGION, SKULL
from rona_core.app.steps.surface.derivation import derive_surface
from rona_core.app.steps.surface.messages import (
    BuildSurface,
    ClearSurface,
    StartSkullRegistration,
    StartSurfaceCapture,
)
from rona_core.app.steps.surface.skull_registration import derive_registration, require_loaded
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session


def capture_surface(
    activity: StartSurfaceCapture, session: Session, tools: ActivityContext
) -> PointerCapture:
    """Record the pointer marker while the pointer slides over the skull."""
    return capture_stroke(
        "surface",
        session,
        tools,
        activity.picks_base_mm,
        activity.duration_s,
        lambda: tools.rig.operator.sweep(duration_s=activity.duration_s),
    )


def record_surface(
    activity: StartSurfaceCapture, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record a stroke over the skull, then build the cloud."""
    require_for(activity, session)
    capture = capture_surface(activity, session, context)
    stored = StoreCapture("surface", capture, activity.append)
    return (stored,) if capture.partial else (stored, BuildSurface())


def clear_surface(message: ClearSurface, session: Session) -> Session:
    """Carry out `ClearSurface`."""
    return replace(session, captures=replace(session.captures, surface=()))


def place_stroke(session: Session, capture: PointerCapture, append: bool) -> object:
    """Return the strokes after another one, which replaces the earlier ones or adds to them."""
    return (*(session.captures.surface if append else ()), capture)


SURFACE_CAPTURE, SURFACE = capture_input("surface"), result_input("surface")
TOOL, POINTER = result_input("tool"), result_input("pointer")
# False where the tracker has moved and may not be found again; it counts for nothing else
REFERENCE = setup_input(lambda s: found_again(s, s.captures.surface), CHOOSE_REFERENCE)


def _require_loaded(activity: StartSkullRegistration, session: Session) -> None:
    require_loaded(session)


def _summary(session: Session) -> str:
    held = session.results.surface
    if held is None:
        return ""
    remark = carried_remark(session, session.captures.surface)
    return f"{len(held.value.points_base)} points{remark}"


STEP = Step(
    "surface",
    commands=(
        Command(BuildSurface, compute_result, needs=(SURFACE_CAPTURE, TOOL, POINTER)),
        Command(ClearSurface, clear_surface),
    ),
    activities=(
        Activity(
            StartSurfaceCapture,
            record_surface,
            "Sliding over the skull",
            needs=(TOOL, POINTER),
            blocked=placed_reason,
            uses_devices=True,
            records=True,
        ),
        Activity(
            StartSkullRegistration,
            compute_one,
            "Laying the points onto the skull",
            needs=(SURFACE,),
            check=_require_loaded,
        ),
    ),
    captures=(
        Capture(
            "surface",
            "slide the pointer over the skull (step 4)",
            (tracker_part, robot_part, pointer_part, specimen_part),
            place=place_stroke,
        ),
    ),
    results=(
        Result(
            "surface",
            BuildSurface,
            derive_surface,
            {
                "capture": SURFACE_CAPTURE,
                "tool": TOOL,
                "pointer": POINTER,
                "reference": REFERENCE,
            },
            "sample the surface (step 4)",
        ),
        Result(
            "registration",
            StartSkullRegistration,
            derive_registration,
            {"surface": SURFACE, "skull": SKULL, "region": REGION},
            "register the skull (step 4)",
            long=True,
        ),
    ),
    line=StepLine(
        "Surface",
        _summary,
        StartSurfaceCapture,
        leaves=lambda session: (SURFACE_CAPTURE, SURFACE),
        partial=lambda session: stopped_early("surface", session),
    ),
)
