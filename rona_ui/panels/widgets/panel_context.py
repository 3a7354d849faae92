"""What a panel is given: ways to send messages and to change this browser's view. Nothing else."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.viewer.bindings import Event


@dataclass(frozen=True, slots=True)
class PanelContext:
    """Ways out of a panel."""

    send: Callable[[Callable[[], Any], Event], None]
    send_debounced: Callable[[object, Callable[[], Any], Event], None]
    change_view: Callable[[Callable[[ViewState], ViewState]], None]
    # save, open, new, show, close, drop, upload, download, finish, cancel, stop, escape
    service: Callable[[str, Event, str | bytes | None], None]
    set_camera: Callable[[str], None]  # preset by name


class Panel(Protocol):
    """Draws its part of the docks from pictures."""

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Bring the panel from ``old`` to ``new``; ``old`` is None for the first time."""
        ...


def on_click(handle: Any, call: Callable[[Any], None]) -> None:
    """Call ``call(event)`` when a button is clicked, in the order of the clicks."""

    @handle.on_click
    async def _(event: Any) -> None:
        call(event)


def on_change(handle: Any, call: Callable[[Any], None]) -> None:
    """Call ``call(event)`` when somebody changes a field; our own writes are dropped."""

    @handle.on_update
    async def _(event: Any) -> None:
        if event.client is not None:
            call(event)
