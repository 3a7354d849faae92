"""Capture of the second pass: the gaps of the inner map are scanned again."""

from rona_core.app.declarations.activity_context import ActivityContext
from rona_core.app.declarations.declarations import Message
from rona_core.app.dependencies.requirements import require_for
from rona_core.app.messages.outcomes import StoreCapture
from rona_core.app.steps.maps.messages import StartGapScan
from rona_core.app.steps.scan.captures import capture_scan
from rona_core.session.document import Session


def record_gap_scan(
    activity: StartGapScan, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record the second pass along its certified plan."""
    require_for(activity, session)
    return (StoreCapture("second", capture_scan(session, context, "second")),)
