"""Read-only: the frame graph, the log, and what was refused last."""

from collections.abc import Sequence
from typing import Any

from scipy.spatial.transform import Rotation

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.changes import logged
from rona_core.app.overview.frame_graph import FrameRow, frame_rows
from rona_core.devices.limits import heading, limits_of
from rona_core.session.document import LogEntry
from rona_ui.labels import label_of, place_of
from rona_ui.panels.widgets import style
from rona_ui.presentation.error_boundary import ErrorBoundary
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.refusals import Refusal
from rona_ui.viewer.bindings import escape


class Refused:
    """What was refused last, until something is done; the log keeps it."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html("")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow refusals, log and active step."""
        if changed(old, new, "refusals", "session.log", "view.step"):
            self._html.content = refused(new)


def refused(snapshot: Snapshot) -> str:
    """Return the newest refusal as HTML; empty once something was done.

    It is empty as well where the reason stands beside what was refused. In another step than where
    it happened it says where that was.
    """
    newest = snapshot.refusals[-1] if snapshot.refusals else None
    if newest is None or newest.explained or newest.after != len(snapshot.session.log):
        return ""
    elsewhere = newest.where and not newest.where.startswith(place_of(snapshot.view.step))
    where = f"{newest.where}: " if elsewhere else ""
    words = f"✖ {where}{newest.title}. {newest.body}"
    return f'<div role="alert">{style.note(words, "warn")}</div>'


class DrawingErrors:
    """Says which error keeps a part of the page from being up to date, as long as it does."""

    def __init__(self, gui: Any, boundary: ErrorBoundary) -> None:
        self._html, self._boundary = gui.add_html(""), boundary
        self._errors: tuple[str, ...] = ()

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow what could be drawn of this snapshot."""
        if self._boundary.errors != self._errors:
            self._errors = self._boundary.errors
            self._html.content = drawing_errors(self._errors)


def drawing_errors(errors: Sequence[str]) -> str:
    """Return as HTML that a part of the page shows an earlier state, and why; "" for no errors."""
    if not errors:
        return ""
    words = (
        "✖ A part of this page could not be drawn and shows an earlier state; the session is "
        f"complete, and all else is up to date. Undo the last change, and report this: {errors[0]}"
    )
    return f'<div role="alert">{style.note(words, "warn")}</div>'


NEWEST = 60
DETAIL_CHARS = 160
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
        "predicted error (of T_base_tracker: at the skull, assumed by what robot and tracker are "
        "stated to be); nominal and live poses and the planes of map and bed have none."
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
    when = entry.time_utc[11:19]
    return (
        f"<div><span>{entry.number} · {escape(when)} UTC</span> <b>{escape(logged(entry))}</b> "
        f"<span>{escape(_details(entry)[:DETAIL_CHARS])}</span></div>"
    )


def _details(entry: LogEntry) -> str:
    """Return the fields of a message by their labels; of a recording its number and file."""
    kind = REGISTRY.messages.get(entry.message)
    if kind is None:
        held, file = entry.arguments.get("capture"), entry.arguments.get("file")
        words = f"recording {held['ordinal']}" if isinstance(held, dict) else ""
        return f"{words} from {file}" if file else words
    found: list[str] = []
    for name, value in entry.arguments.items():
        words = limits_of(kind).get(name, {})
        label = heading(words) if "label" in words else label_of(name)
        called = words.get("labels", {}).get(value, value) if isinstance(value, str) else value
        found.append(f"{label}: {_short(called)}")
    return ", ".join(found)


def _refused(refusal: Refusal) -> str:
    icon, _, color = style.VERDICTS["fail"]
    where = f" · {refusal.where}" if refusal.where else ""
    return (
        f"<div><span>{escape(refusal.time_utc[11:19])} UTC{escape(where)}</span> "
        f'<b style="color:{color}">{icon} {escape(refusal.title)}</b><br>'
        f"{escape(refusal.body)}</div>"
    )


def _short(value: object) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict) or (isinstance(value, list) and len(value) > 3):
        return f"{len(value)} values"
    return ", ".join(map(_short, value)) if isinstance(value, list) else str(value)


WIDTH = 340  # with room for a scroll bar at the right
PLACES: dict[str, tuple[int, int]] = {  # centres of the boxes, in px; no arrow crosses a box
    "tracker": (165, 22),
    "basemarker": (56, 93),
    "toolmarker": (163, 138),
    "pointermarker": (270, 80),
    "flange": (101, 188),
    "tip": (183, 206),
    "headmarker": (270, 220),
    "base": (31, 234),
    "probe": (115, 252),
    "pointertip": (190, 268),
    "burr": (266, 270),
    "skull": (88, 290),
    "bed": (24, 306),
    "map": (66, 340),
}
EXPECTED = (  # what a complete session knows
    ("tracker", "basemarker"),
    ("tracker", "toolmarker"),
    ("tracker", "pointermarker"),
    ("tracker", "headmarker"),
    ("base", "basemarker"),
    ("base", "headmarker"),
    ("base", "tracker"),
    ("base", "flange"),
    ("flange", "toolmarker"),
    ("flange", "probe"),
    ("flange", "tip"),
    ("toolmarker", "tip"),
    ("tip", "burr"),
    ("base", "map"),
    ("base", "bed"),
    ("pointermarker", "pointertip"),
)
INK, LIVE, STALE, FAINT = "#3e4c59", "#005b8f", "#a34700", "#9aa5b1"
COLORS = {"known": INK, "live": LIVE, "stale": STALE}
LINES = {  # state of a transform -> how its line is drawn
    "known": f'stroke="{INK}" stroke-width="1.5"',
    "live": f'stroke="{LIVE}" stroke-width="2.4"',
    "stale": f'stroke="{STALE}" stroke-width="1.5" stroke-dasharray="5 4"',
    "unknown": f'stroke="{FAINT}" stroke-width="1" stroke-dasharray="1 4"',
}
HALF_HEIGHT, CHAR_PX = 11, 3.4
FIRST_ROW_BELOW = 380


def frame_picture(rows: Sequence[FrameRow]) -> str:
    """Return the graph as SVG, for a dock of 330 px or more; it says in words what it shows."""
    places = _places(rows)
    height = max(y for _, y in places.values()) + 22
    known = {(row.parent, row.child) for row in rows}
    lines = [_edge("unknown", *edge, places) for edge in EXPECTED if edge not in known]
    lines += [_edge(_kind(row), row.parent, row.child, places) for row in rows]
    badges = "".join(_badge(n, row, places) for n, row in enumerate(rows, start=1))
    boxes = "".join(_box(name, x, y) for name, (x, y) in places.items())
    heads = "".join(_head(kind, color) for kind, color in COLORS.items())
    stale = sum(row.stale_reason is not None for row in rows)
    words = f"Frame graph: {len(rows)} transforms known, {stale} of them stale. The list follows."
    return (
        f'<svg class="r-frames" role="img" aria-label="{escape(words)}" viewBox="0 0 {WIDTH} '
        f'{height}" width="100%" style="max-width:{WIDTH + 60}px;display:block;margin:4px auto" '
        'font-family="system-ui,Arial,sans-serif">'
        f"<title>{escape(words)}</title><defs>{heads}</defs>{''.join(lines)}{boxes}{badges}</svg>"
    )


def _places(rows: Sequence[FrameRow]) -> dict[str, tuple[int, int]]:
    """Return where each frame is drawn; those that Figure 4 does not know stand below."""
    wanted = {frame for edge in EXPECTED for frame in edge}
    wanted |= {frame for row in rows for frame in (row.parent, row.child)}
    places = {name: place for name, place in PLACES.items() if name in wanted}
    others = sorted(wanted - places.keys())
    for i, name in enumerate(others):
        places[name] = (55 + 110 * (i % 3), FIRST_ROW_BELOW + 40 * (i // 3))
    return places


def _kind(row: FrameRow) -> str:
    return "stale" if row.stale_reason is not None else "live" if row.live else "known"


def _half_width(name: str) -> float:
    return CHAR_PX * len(name) + 6.0


def _ends(
    left: str, right: str, places: dict[str, tuple[int, int]]
) -> tuple[float, float, float, float]:
    """Return where the line between two boxes leaves the one and meets the other."""
    (x1, y1), (x2, y2) = places[left], places[right]
    dx, dy = x2 - x1, y2 - y1

    def share(name: str) -> float:
        across = _half_width(name) / abs(dx) if dx else 9.0
        along = (HALF_HEIGHT + 1) / abs(dy) if dy else 9.0
        return min(across, along, 0.45)

    a, b = share(left), share(right)
    return x1 + a * dx, y1 + a * dy, x2 - b * dx, y2 - b * dy


def _edge(kind: str, left: str, right: str, places: dict[str, tuple[int, int]]) -> str:
    x1, y1, x2, y2 = _ends(left, right, places)
    arrow = "" if kind == "unknown" else f' marker-end="url(#rf-{kind})"'
    return (
        f'<line class="{kind}" x1="{x1:.0f}" y1="{y1:.0f}" x2="{x2:.0f}" y2="{y2:.0f}" '
        f"{LINES[kind]}{arrow}/>"
    )


def _badge(number: int, row: FrameRow, places: dict[str, tuple[int, int]]) -> str:
    """Return the number at the middle of an arrow, with a word where it is stale or live."""
    kind = _kind(row)
    x1, y1, x2, y2 = _ends(row.parent, row.child, places)
    x, y, color = (x1 + x2) / 2, (y1 + y2) / 2, COLORS[kind]
    word = "" if kind == "known" else kind
    label = (
        f'<text x="{x + 10:.0f}" y="{y + 4:.0f}" font-size="10.5" fill="{color}" stroke="#fff" '
        f'stroke-width="3" paint-order="stroke">{word}</text>'
        if word
        else ""
    )
    return (
        f"<g><title>{escape(_words(number, row))}</title>"
        f'<circle cx="{x:.0f}" cy="{y:.0f}" r="7.5" fill="#fff" stroke="{color}"/>'
        f'<text x="{x:.0f}" y="{y + 3.6:.0f}" font-size="10" text-anchor="middle" '
        f'fill="{color}">{number}</text>{label}</g>'
    )


def _words(number: int, row: FrameRow) -> str:
    return f"{number}: {row.name}" + (f", stale: {row.stale_reason}" if row.stale_reason else "")


def _box(name: str, x: int, y: int) -> str:
    half = _half_width(name)
    return (
        f'<rect x="{x - half:.0f}" y="{y - HALF_HEIGHT}" width="{2 * half:.0f}" '
        f'height="{2 * HALF_HEIGHT}" rx="5" fill="#f1f4f7" stroke="#52606d"/>'
        f'<text x="{x}" y="{y + 4}" font-size="11.5" text-anchor="middle" fill="#1f2933">'
        f"{escape(name)}</text>"
    )


def _head(kind: str, color: str) -> str:
    return (
        f'<marker id="rf-{kind}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="9" '
        'markerHeight="9" markerUnits="userSpaceOnUse" orient="auto">'
        f'<path d="M0 0 L10 5 L0 10 z" fill="{color}"/></marker>'
    )
