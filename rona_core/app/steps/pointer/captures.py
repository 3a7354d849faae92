"""Captures of the pointer calibration."""

from rona_core.app.declarations.activity_context import ActivityContext
from rona_core.app.declarations.declarations import Message
from rona_core.app.messages.outcomes import StoreCapture
from rona_core.app.runtime.recording import capture_hand
from rona_core.app.steps.pointer.messages import CalibratePointer, StartPointerCapture
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session


def capture_pivot(
    activity: StartPointerCapture, session: Session, tools: ActivityContext
) -> PointerCapture:
    """Record the pointer marker while the pointer pivots about its tip."""
    operator = tools.rig.operator
    if not activity.by_hand:
        return capture_hand(
            "pointer",
            session,
            tools,
            lambda: operator.pivot(cone_deg=activity.cone_deg, duration_s=activity.duration_s),
        )
    try:
        return capture_hand(
            "pointer",
            session,
            tools,
            lambda: operator.pivot_by_hand(duration_s=activity.duration_s),
            lambda: not operator.in_hand(),
        )
    finally:
        operator.finish()


def record_pivot(
    activity: StartPointerCapture, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record the pivoting of the pointer, then calibrate it."""
    capture = capture_pivot(activity, session, context)
    stored = StoreCapture("pointer", capture)
    return (stored,) if capture.partial else (stored, CalibratePointer())
