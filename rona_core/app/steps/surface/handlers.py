"""Handlers of the surface."""

from dataclasses import replace

from rona_core.app.steps.surface.messages import ClearSurface
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session


def clear_surface(message: ClearSurface, session: Session) -> Session:
    """Carry out `ClearSurface`."""
    return replace(session, captures=replace(session.captures, surface=()))


def place_stroke(session: Session, capture: PointerCapture, append: bool) -> object:
    """Return the strokes after another one, which replaces the earlier ones or adds to them."""
    return (*(session.captures.surface if append else ()), capture)
