"""Registration of the burr: one button, and what is known of the tip."""

from typing import Any

from rona_core.app.dependencies.requirements import blocked_reason
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.implant.burr.view import UNKNOWN, burr_view
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext
from rona_ui.presentation.snapshot import Snapshot, changed


class BurrFields:
    """The button that registers the burr, and one line about its tip."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._register = context.send_button(gui, "Register burr", "target", StartBurrCapture)
        self._found = gui.add_html("")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the registration."""
        if not changed(old, new, "session", "busy"):
            return
        blocked = blocked_reason(StartBurrCapture, new.session) is not None
        self._register.disabled = bool(new.busy) or blocked
        self._found.content = "" if blocked else burr_note(new.session)


def burr_note(session: Session) -> str:
    """Return what is known of the tip of the burr as HTML."""
    view = burr_view(session)
    if view is None:
        return style.note(UNKNOWN, "warn")
    return style.note(view.sentence, "warn" if view.verdict in ("bad", "stale") else "")
