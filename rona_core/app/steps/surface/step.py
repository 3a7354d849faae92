"""Surface: point cloud of the skull, and where a loaded skull lies under it."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Input
from rona_core.app.dependencies.base_reference import carried_remark, found_again, placed_reason
from rona_core.app.dependencies.inputs import capture_input, result_input
from rona_core.app.runtime.handling import compute_one, compute_result, record
from rona_core.app.runtime.recording import capture_stroke
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.setup.inputs import CHOOSE_REFERENCE, REGION, SKULL
from rona_core.app.steps.surface import messages
from rona_core.app.steps.surface.derivation import derive_surface
from rona_core.app.steps.surface.skull_registration import derive_registration, require_loaded
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session

SURFACE_CAPTURE, SURFACE = capture_input("surface"), result_input("surface")
TOOL, POINTER = result_input("tool"), result_input("pointer")
# False where the tracker has moved and may not be found again; it counts for nothing else
REFERENCE = Input(lambda s: found_again(s, s.captures.surface), CHOOSE_REFERENCE)


def capture_surface(
    activity: messages.StartSurfaceCapture, session: Session, context: ActivityContext
) -> PointerCapture:
    """Record the pointer marker while the pointer slides over the skull."""
    return capture_stroke(
        "surface",
        session,
        context,
        activity.picks_base_mm,
        activity.duration_s,
        lambda: context.rig.operator.sweep(duration_s=activity.duration_s),
    )


def clear_surface(message: messages.ClearSurface, session: Session) -> Session:
    """Carry out `ClearSurface`."""
    return session.with_capture("surface", ())


def place_stroke(session: Session, capture: PointerCapture, append: bool) -> object:
    """Return the strokes after another one, which replaces the earlier ones or adds to them."""
    return (*(session.captures.surface if append else ()), capture)


def _require_loaded(activity: messages.StartSkullRegistration, session: Session) -> None:
    require_loaded(session)


def _summary(session: Session) -> str:
    held = session.results.surface
    if held is None:
        return ""
    remark = carried_remark(session, session.captures.surface)
    return f"{len(held.value.points_base)} points{remark}"


STEP = declare.Step(
    "surface",
    commands=(
        declare.Command(
            messages.BuildSurface, compute_result, needs=(SURFACE_CAPTURE, TOOL, POINTER)
        ),
        declare.Command(messages.ClearSurface, clear_surface),
    ),
    activities=(
        declare.Activity(
            messages.StartSurfaceCapture,
            record("surface", capture_surface, messages.BuildSurface),
            "Sliding over the skull",
            needs=(TOOL, POINTER),
            blocked=placed_reason,
            records=True,
        ),
        declare.Activity(
            messages.StartSkullRegistration,
            compute_one,
            "Laying the points onto the skull",
            needs=(SURFACE,),
            check=_require_loaded,
        ),
    ),
    captures=(
        declare.Capture(
            "surface",
            "slide the pointer over the skull (step 4)",
            (parts.tracker, parts.robot, parts.pointer, parts.specimen, parts.HEAD),
            place=place_stroke,
        ),
    ),
    results=(
        declare.Result(
            "surface",
            messages.BuildSurface,
            derive_surface,
            {
                "capture": SURFACE_CAPTURE,
                "tool": TOOL,
                "pointer": POINTER,
                "reference": REFERENCE,
            },
            "sample the surface (step 4)",
        ),
        declare.Result(
            "registration",
            messages.StartSkullRegistration,
            derive_registration,
            {"surface": SURFACE, "skull": SKULL, "region": REGION},
            "register the skull (step 4)",
        ),
    ),
    line=declare.StepLine(
        "Surface",
        _summary,
        messages.StartSurfaceCapture,
        leaves=lambda session: (SURFACE_CAPTURE, SURFACE),
    ),
)
