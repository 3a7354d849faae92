"""Two read-only tabs: the frame graph and the log."""

from typing import Any

from scipy.spatial.transform import Rotation

from rona_core.app.overview.frame_graph import FrameRow, frame_rows
from rona_core.session.document import LogEntry
from rona_ui.panels.layout.frame_graph_image import frame_picture
from rona_ui.panels.widgets import style
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.refusals import Refusal
from rona_ui.viewer.bindings import escape

NEWEST = 60
ARGUMENT_CHARS = 160
NOTHING = "Nothing has happened yet."


class FramesPanel:
    """Every transform that the session knows: a picture, and a list with source, time and error."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html("")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the session, and which transforms the devices report."""
        if old is None or old.session is not new.session or _reported(old) != _reported(new):
            rows = frame_rows(new.session, new.live)
            self._html.content = frame_picture(rows) + frames_table(rows)


def _reported(snapshot: Snapshot) -> tuple[object, ...]:
    """Return what is live: not its values, which change thirty times a second."""
    frame, joints = snapshot.live.frame, snapshot.live.joints
    seen = () if frame is None else tuple(s.tool for s in frame.tools if s.T_tracker_marker)
    return (*seen, joints is not None)


def frames_table(rows: tuple[FrameRow, ...]) -> str:
    """Return the transforms as a list: name, source and time, predicted error, pose."""
    body = "".join(_frame(number, row) for number, row in enumerate(rows, start=1))
    words = style.text(
        "T_a_b is the pose of frame b in frame a: origin and rotation vector. σ is the "
        "predicted error (of T_base_tracker: at the skull); nominal and live poses have none."
    )
    return f'<div class="r-log" role="list">{body}</div>{words}'


def _frame(number: int, row: FrameRow) -> str:
    made = "" if row.time_utc is None else f", {row.time_utc[11:19]} UTC"
    lines = [f"{number}. <b>{escape(row.name)}</b> <span>{escape(row.source + made)}</span>"]
    if not row.live:  # those change thirty times a second
        turn = _three(Rotation.from_matrix(row.pose.rotation).as_rotvec(degrees=True), 1)
        lines.append(f"<span>at {_three(row.pose.translation, 2)} mm, rotation {turn}°</span>")
    if row.sigma_mm is not None:
        turn = "" if row.sigma_deg is None else f", {row.sigma_deg:.2g}°"
        lines.append(escape(f"σ {row.sigma_mm:.2f} mm{turn}"))
    if row.stale_reason is not None:
        icon, word, color = style.STATES["stale"]
        words = escape(f"{icon} {word}: {row.stale_reason}")
        lines.append(f'<span style="color:{color}">{words}</span>')
    return f'<div role="listitem">{"<br>".join(lines)}</div>'


def _three(values: Any, decimals: int) -> str:
    return "(" + ", ".join(f"{float(v):.{decimals}f}" for v in values) + ")"


class LogPanel:
    """The newest messages of the session and what was refused between them, the last one first."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html(style.text(NOTHING))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the log and the refusals."""
        log, refusals = new.session.log, new.refusals
        if not changed(old, new, "session.log", "refusals"):
            return
        lines = [(entry.number, _line(entry)) for entry in log[-NEWEST:]]
        lines += [(refusal.after, _refused(refusal)) for refusal in refusals]
        lines.sort(key=lambda line: line[0])  # of one number the message comes first
        shown = "".join(line for _, line in reversed(lines[-NEWEST:]))
        self._html.content = f'<div class="r-log">{shown}</div>' if lines else style.text(NOTHING)


def _line(entry: LogEntry) -> str:
    arguments = ", ".join(f"{name} {_short(value)}" for name, value in entry.arguments.items())
    when = entry.time_utc[11:19]
    return (
        f"<div><span>{entry.number} · {escape(when)} UTC</span> <b>{escape(entry.message)}</b> "
        f"<span>{escape(arguments[:ARGUMENT_CHARS])}</span></div>"
    )


def _refused(refusal: Refusal) -> str:
    icon, _, color = style.VERDICTS["fail"]
    where = f" · {refusal.where}" if refusal.where else ""
    return (
        f"<div><span>{escape(refusal.time_utc[11:19])} UTC{escape(where)}</span> "
        f'<b style="color:{color}">{icon} {escape(refusal.title)}</b><br>'
        f"{escape(refusal.body)}</div>"
    )


def _short(value: object) -> str:
    if isinstance(value, dict):
        return str(value.get("ordinal", value.get("digest", "")))[:10]
    return f"{len(value)} values" if isinstance(value, list) and len(value) > 3 else str(value)
