"""Panel context: the callbacks through which a panel sends messages and changes the view."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.viewer.bindings import Event


@dataclass(frozen=True, slots=True)
class PanelContext:
    """Callbacks of a panel."""

    send: Callable[[Callable[[], Any], Event], None]
    send_debounced: Callable[[object, Callable[[], Any], Event], None]
    change_view: Callable[[Callable[[ViewState], ViewState]], None]
    # save, upload, export, compare, finish, cancel, escape, resume
    service: Callable[[str, Event, str | bytes | None], None]
    set_camera: Callable[[str], None]  # preset by name

    def set_view(self, **fields: Any) -> None:
        """Set fields of the view of this browser."""
        self.change_view(lambda view: replace(view, **fields))

    def send_button(
        self, gui: Any, label: str, icon: str, make: Callable[[], Any], **options: Any
    ) -> Any:
        """Add a button that sends the message ``make()``; grey unless ``color`` says otherwise."""
        button = gui.add_button(label, icon=icon, **{"color": "gray", **options})
        on_click(button, lambda event: self.send(make, event))
        return button

    def view_button(
        self, gui: Any, label: str, icon: str, *, color: str | None = "gray", **fields: Any
    ) -> Any:
        """Add a button that sets fields of the view."""
        button = gui.add_button(label, icon=icon, color=color)
        on_click(button, lambda event: self.set_view(**fields))
        return button

    def show_layer(self, name: str, shown: bool) -> None:
        """Switch a layer of the scene on or off."""
        layer = frozenset((name,))
        self.change_view(
            lambda v: replace(v, hidden=v.hidden - layer if shown else v.hidden | layer)
        )


class Panel(Protocol):
    """Draws its part of the docks from snapshots."""

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Bring the panel from ``old`` to ``new``; ``old`` is None for the first time."""
        ...


def on_click(handle: Any, call: Callable[[Any], None]) -> None:
    """Call ``call(event)`` when a button is clicked, in the order of the clicks."""

    @handle.on_click
    async def _(event: Any) -> None:
        call(event)


def on_change(handle: Any, call: Callable[[Any], None]) -> None:
    """Call ``call(event)`` when a user changes a field; our own writes are ignored."""

    @handle.on_update
    async def _(event: Any) -> None:
        if event.client is not None:
            call(event)
