"""Inputs of what rests on further passes over the bone."""

from rona_core.app.declarations.inputs import Input
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.session.captures import ScanCapture
from rona_core.session.document import Session

Passes = tuple[ScanCapture, ...]  # further ones, with the probe tilted


def usable_second(session: Session) -> Passes:
    """Return the further passes; none where they are of another scan or set-up."""
    held = session.captures.second
    return () if not held or stale_reason("capture second", session) else held


PASSES: Input[Passes] = Input(
    usable_second, None, "capture second", counts=lambda s: s.captures.second
)
ANY_PASSES: Input[Passes] = Input(
    usable_second,
    "scan with the probe tilted (step 9)",
    optional=True,
    counts=lambda s: s.captures.second,
    part="capture second",
)
