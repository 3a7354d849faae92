"""List of what was refused in the session: it stays where a notice goes by itself."""

from typing import Any

from rona_ui.labels import place_of
from rona_ui.panels.widgets import style
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import escape


class Refused:
    """What was refused: the newest while nothing has been done since, and all of the session."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html("")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow refusals, log and active step."""
        if changed(old, new, "refusals", "session.log", "view.step"):
            self._html.content = refused(new)


def refused(snapshot: Snapshot) -> str:
    """Return the refusals as HTML; that of the active step stands in full until it is outdated."""
    refusals = snapshot.refusals
    if not refusals:
        return ""
    newest, here = refusals[-1], place_of(snapshot.view.step)
    of_now = newest.after == len(snapshot.session.log) and newest.where.startswith(here)
    full = style.note(f"✖ {newest.title}. {newest.body}", "warn") if of_now else ""
    lines = "".join(
        f"<li><span>{escape(r.time_utc[11:19])} UTC, {escape(r.where or 'session')}</span><br>"
        f"<b>{escape(r.title)}</b>: {escape(r.body)}</li>"
        for r in reversed(refusals)
    )
    count = "1 message" if len(refusals) == 1 else f"{len(refusals)} messages"
    title = f"{count}: what was not done, and why"
    return f'{full}<details class="r-refused"><summary>{title}</summary><ul>{lines}</ul></details>'
