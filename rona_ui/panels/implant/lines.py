"""Further lines for the bed: found, planned as a further pass, and how much they can tell."""

from typing import Any

from rona_core.app.dependencies.judge import blocked, fresh
from rona_core.app.steps.implant.bed_lines import BedLines, lines_verdict
from rona_core.app.steps.implant.messages import StartBedLines
from rona_core.app.steps.maps.messages import StartGapPlan
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.presentation.snapshot import Snapshot, changed

EXPLANATION = "Where to scan on, so that the bone below this bed is known better."
NEXT = "Then scan it (step 9, second pass), map again and lay the bed anew."


class LinesFolder:
    """The button that finds lines, and the one that plans a further pass along them."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._rows: tuple[Any, ...] = ()
        self._window = gui.add_folder("Scan for this bed", visible=False, expand_by_default=False)
        with self._window:
            gui.add_html(style.text(EXPLANATION))
            self._words = gui.add_html("")
            self._find = context.send_button(gui, "Find lines", "search", StartBedLines)
            self._plan = gui.add_button("Plan pass along them", icon="route", color="gray")
            gui.add_html(style.text(NEXT))

        def plan(event: Any) -> None:
            context.send(lambda: StartGapPlan(rows=self._rows), event)
            context.set_view(second=True, cursor=None, playing=False)

        on_click(self._plan, plan)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the bed and its lines."""
        self._window.visible = new.milling is not None
        if not changed(old, new, "session", "busy"):
            return
        found = _fresh(new.session)
        self._rows = () if found is None else found.rows
        self._find.disabled = bool(new.busy) or blocked(StartBedLines, new.session) is not None
        self._plan.disabled = bool(new.busy) or not self._rows
        self._words.content = "" if found is None else style.note(lines_verdict(found))


def _fresh(session: Session) -> BedLines | None:
    """Return the lines that were found for the bed of now."""
    return fresh("lines", session)
