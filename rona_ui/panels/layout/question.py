"""A question that somebody has to answer before work goes out of sight or is lost."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import on_click
from rona_ui.viewer.bindings import Event

COLORS = {"save": None, "keep": "gray", "lose": (176, 0, 32)}  # None: that of the primary button
ICONS = {"save": "device-floppy", "keep": None, "lose": "trash"}


@dataclass(frozen=True, slots=True)
class Choice:
    """One answer, and what it does."""

    label: str
    act: Callable[[Event], None]
    kind: Literal["save", "keep", "lose"] = "keep"


class Question:
    """Asks in a window over the viewer; Cancel is always an answer."""

    def __init__(self, gui: Any) -> None:
        self._gui = gui
        self._modal: Any = None

    def ask(self, title: str, words: str, choices: tuple[Choice, ...]) -> None:
        """Show a question in place of the one before; any answer closes it."""
        self._answered()
        self._modal = self._gui.add_modal(title)
        with self._modal:
            self._gui.add_html(style.text(words))
            for choice in (*choices, Choice("Cancel", lambda event: None)):
                self._add(choice)

    def cancel(self) -> bool:
        """Answer with Cancel; return whether a question was open."""
        return self._answered()

    def _add(self, choice: Choice) -> None:
        button = self._gui.add_button(
            choice.label, icon=ICONS[choice.kind], color=COLORS[choice.kind]
        )

        def answer(event: Event) -> None:
            self._answered()
            choice.act(event)

        on_click(button, answer)

    def _answered(self) -> bool:
        modal, self._modal = self._modal, None
        if modal is not None:
            modal.close()
        return modal is not None
