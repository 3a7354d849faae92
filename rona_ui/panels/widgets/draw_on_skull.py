"""Strokes drawn on the skull by mouse (steps 4 and 5)."""

from collections.abc import Callable
from typing import Any

from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import Drawing


class DrawingControls:
    """Buttons to draw, finish or discard a stroke."""

    def __init__(
        self,
        gui: Any,
        context: PanelContext,
        kind: Drawing,
        message: Callable[[tuple[Any, ...]], Any],
    ) -> None:
        self._kind, self._context, self._message = kind, context, message
        self._picks: tuple[Any, ...] = ()
        self._begin = context.view_button(gui, "Draw on the skull", "pencil", drawing=kind)
        self._help = gui.add_html("")
        self._finish = gui.add_button("Finish stroke", icon="check", visible=False)
        on_click(self._finish, self._send)
        self._drop = context.view_button(gui, "Discard stroke", "x", drawing=None, picks=())

    def _send(self, event: Any) -> None:
        picks = self._picks
        self._context.send(lambda: self._message(picks), event)
        self._context.set_view(drawing=None, picks=())

    def render(self, new: Snapshot) -> None:
        """Show what can be done now."""
        drawing = new.view.drawing == self._kind
        self._picks = new.view.picks
        blocked = new.busy or new.step(self._kind).state == "blocked"
        self._begin.visible = not drawing
        self._begin.label = "Continue drawing" if self._picks else "Draw on the skull"
        self._begin.disabled = blocked
        self._finish.visible = drawing
        self._drop.visible = drawing or len(self._picks) > 0
        self._finish.disabled = blocked or len(self._picks) < 2
        words = (
            "Click points on the skull, or drag over it. Dragging beside the skull "
            f"rotates the view. {len(self._picks)} points so far."
        )
        self._help.content = style.note(words) if drawing else ""
