"""Stroke of the pointer under way, as far as it has come, for the drawing thread."""

from rona_core.app.steps.surface.growing_stroke import StrokeGrower
from rona_core.devices.live import LiveState
from rona_core.geometry.arrays import Floats
from rona_core.session.document import Session


class StrokeGrowth:
    """Follows the strokes of the current session, one after the other."""

    def __init__(self) -> None:
        self._grower: tuple[tuple[str, int], StrokeGrower] | None = None

    def ask(self, session: Session, live: LiveState) -> Floats | None:
        """Return the tip (k, 3) in ``base`` so far; None while no stroke is recorded."""
        if not live.frames:
            self._grower = None
            return None
        key = session.id, live.ordinal
        if self._grower is None or self._grower[0] != key:
            self._grower = key, StrokeGrower(session)
        return self._grower[1].grown(live.frames)
