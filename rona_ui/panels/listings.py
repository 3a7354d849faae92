"""Two read-only tabs: the frame graph and the log."""

from typing import Any

import numpy as np

from rona_core.app.frames import FrameRow, frame_rows
from rona_core.session.document import LogEntry
from rona_ui.bindings import escape
from rona_ui.panels import style
from rona_ui.view_state import Picture

NEWEST = 60
ARGUMENT_CHARS = 160


class FramesPanel:
    """Every transform that the session knows, with its source."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html("")

    def render(self, old: Picture | None, new: Picture) -> None:
        """Follow results and set-up."""
        if (
            old is None
            or old.session.results is not new.session.results
            or old.session.setup is not new.session.setup
        ):
            self._html.content = frames_table(frame_rows(new.session))


def frames_table(rows: tuple[FrameRow, ...]) -> str:
    """Return the transforms: name, source, translation in mm, rotation vector in degrees."""
    body = ""
    for row in rows:
        turn = np.rad2deg(_rotvec(row.pose.wxyz()))
        stale = ' <span style="color:#a34700">! stale</span>' if row.stale_reason else ""
        body += (
            f"<tr><td><b>{escape(row.name)}</b>{stale}<br>"
            f'<span class="g">{escape(row.source)}</span></td>'
            f'<td class="n">{_three(row.pose.translation, 2)}</td>'
            f'<td class="n">{_three(turn, 1)}</td></tr>'
        )
    head = (
        '<tr><th>Transform and its source</th><th class="n">x, y, z (mm)</th>'
        '<th class="n">turn (deg)</th></tr>'
    )
    words = style.text("T_a_b is the pose of b in a; the turn is a rotation vector about x, y, z.")
    return f'<table class="r-table">{head}{body}</table>{words}'


def _rotvec(wxyz: Any) -> Any:
    length = float(np.linalg.norm(wxyz[1:]))
    if length < 1e-12:
        return np.zeros(3)
    return wxyz[1:] / length * 2.0 * np.arctan2(length, wxyz[0])


def _three(values: Any, decimals: int) -> str:
    return "<br>".join(f"{float(v):.{decimals}f}" for v in values)


class LogPanel:
    """The newest messages of the session, the last one first."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html(style.text("Nothing has happened yet."))

    def render(self, old: Picture | None, new: Picture) -> None:
        """Follow the log."""
        if (old is None or old.session.log is not new.session.log) and new.session.log:
            lines = "".join(_line(entry) for entry in reversed(new.session.log[-NEWEST:]))
            self._html.content = f'<div class="r-log">{lines}</div>'


def _line(entry: LogEntry) -> str:
    arguments = ", ".join(f"{name} {_short(value)}" for name, value in entry.arguments.items())
    when = entry.time_utc[11:19]
    return (
        f"<div><span>{entry.number} · {escape(when)} UTC</span> <b>{escape(entry.message)}</b> "
        f"<span>{escape(arguments[:ARGUMENT_CHARS])}</span></div>"
    )


def _short(value: object) -> str:
    if isinstance(value, dict):
        return str(value.get("ordinal", value.get("digest", "")))[:10]
    return f"{len(value)} values" if isinstance(value, list) and len(value) > 3 else str(value)
