"""What a panel is given: ways to send messages and to change this browser's view. Nothing else."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from rona_ui.view_state import Picture, ViewState
from rona_ui.viewer.bindings import Event


@dataclass(frozen=True, slots=True)
class Door:
    """Ways out of a panel."""

    send: Callable[[Callable[[], Any], Event], None]
    send_settled: Callable[[object, Callable[[], Any], Event], None]
    view: Callable[[Callable[[ViewState], ViewState]], None]
    # save, open, new, show, close, drop, upload, download, finish, cancel, stop, escape
    service: Callable[[str, Event, str | bytes | None], None]
    look: Callable[[str], None]  # camera preset by name


class Panel(Protocol):
    """Draws its part of the docks from pictures."""

    def render(self, old: Picture | None, new: Picture) -> None:
        """Bring the panel from ``old`` to ``new``; ``old`` is None for the first time."""
        ...


def listen(handle: Any, call: Callable[[Any], None]) -> None:
    """Call ``call(event)`` when a button is clicked, in the order of the clicks."""

    @handle.on_click
    async def _(event: Any) -> None:
        call(event)


def follow(handle: Any, call: Callable[[Any], None]) -> None:
    """Call ``call(event)`` when somebody changes a field; our own writes are dropped."""

    @handle.on_update
    async def _(event: Any) -> None:
        if event.client is not None:
            call(event)
