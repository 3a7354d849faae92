"""Captures of the scan path: a stroke that demonstrates it."""

from rona_core.app.declarations.activity_context import ActivityContext
from rona_core.app.declarations.declarations import Message
from rona_core.app.dependencies.requirements import require_for
from rona_core.app.messages.outcomes import StoreCapture
from rona_core.app.steps.path.messages import BuildPath, StartPathCapture
from rona_core.app.steps.surface.captures import capture_stroke
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
