"""Captures of the surface: strokes of the pointer over the skull."""

from collections.abc import Callable

import numpy as np

from rona_core.app.declarations.activity_context import ActivityContext
from rona_core.app.declarations.declarations import Message
from rona_core.app.dependencies.requirements import require_for
from rona_core.app.messages.outcomes import StoreCapture
from rona_core.app.messages.session_messages import Point
from rona_core.app.runtime.recording import capture_hand
from rona_core.app.steps.surface.messages import BuildSurface, StartSurfaceCapture
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


def capture_stroke(
    kind: str,
    session: Session,
    tools: ActivityContext,
    picks_base_mm: tuple[Point, ...],
    duration_s: float,
    without_picks: Callable[[], float],
) -> PointerCapture:
    """Let the pointer follow the picked places; without any, do what the operator does alone."""
    picks = np.array(picks_base_mm)

    def along_picks() -> float:
        return tools.rig.operator.stroke(picks, duration_s=duration_s)

    return capture_hand(kind, session, tools, along_picks if len(picks) else without_picks)


def record_surface(
    activity: StartSurfaceCapture, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record a stroke over the skull, then build the cloud."""
    require_for(activity, session)
    capture = capture_surface(activity, session, context)
    stored = StoreCapture("surface", capture, activity.append)
    return (stored,) if capture.partial else (stored, BuildSurface())
