"""A result computed from what a session holds, without storing it."""

from typing import Any

from rona_core.app.declarations.declarations import Message
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.handling import derive
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.session.document import Session


def derived(
    name: str,
    session: Session,
    message: Message,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Any:
    """Return the value of a result as a message makes it."""
    result = REGISTRY.result(name, type(message).__name__)
    return derive(result, session, message, progress=progress, cancel=cancel)
