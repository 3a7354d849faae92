"""Registration of the burr: one button, and what is known of the tip."""

from typing import Any

from rona_core.app.dependencies.judge import blocked, judge_part
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.implant.burr.view import UNKNOWN, burr_words
from rona_ui.panels.widgets.panel_context import PanelContext
from rona_ui.panels.widgets.step_panel import JudgementNote
from rona_ui.presentation.snapshot import Snapshot, changed


class BurrFields:
    """The button that registers the burr, and one line about its tip."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._register = context.send_button(gui, "Register burr", "target", StartBurrCapture)
        self._found = JudgementNote(gui, context)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the registration."""
        if not changed(old, new, "session", "busy"):
            return
        hindrance = blocked(StartBurrCapture, new.session)
        self._register.disabled = bool(new.busy) or hindrance is not None
        words = "" if hindrance is not None else burr_words(new.session) or UNKNOWN
        self._found.show(words, judge_part("burr", new.session), busy=bool(new.busy))
