"""The frame graph as a picture: frames as boxes, transforms as numbered arrows (paper, Figure 4).

A live transform is a heavy line, a stale one a dashed line with the word "stale", one that is not
known yet a faint dotted line. The numbers are those of the list below the picture.
"""

from collections.abc import Sequence

from rona_core.app.overview.frame_graph import FrameRow
from rona_ui.viewer.bindings import escape

WIDTH = 340  # with room for a scroll bar at the right
PLACES: dict[str, tuple[int, int]] = {  # centres of the boxes, in px
    "tracker": (165, 22),
    "basemarker": (47, 112),
    "toolmarker": (166, 132),
    "pointermarker": (278, 112),
    "flange": (118, 206),
    "base": (34, 278),
    "probe": (112, 290),
    "tip": (196, 290),
    "pointertip": (284, 278),
    "skull": (164, 344),
}
EXPECTED = (  # what a complete session knows
    ("tracker", "basemarker"),
    ("tracker", "toolmarker"),
    ("tracker", "pointermarker"),
    ("base", "basemarker"),
    ("base", "tracker"),
    ("base", "flange"),
    ("flange", "toolmarker"),
    ("flange", "probe"),
    ("flange", "tip"),
    ("toolmarker", "tip"),
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
FIRST_ROW_BELOW = 344


def frame_picture(rows: Sequence[FrameRow]) -> str:
    """Return the graph as SVG, for a dock of 330 px or more; it says in words what it shows."""
    places = _places(rows)
    height = max(y for _, y in places.values()) + 22
    known = {(row.parent, row.child) for row in rows}
    lines = [_line("unknown", *edge, places) for edge in EXPECTED if edge not in known]
    lines += [_line(_kind(row), row.parent, row.child, places) for row in rows]
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
        places[name] = (55 + 110 * (i % 3), FIRST_ROW_BELOW + 40 * (i // 3 + ("skull" in wanted)))
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


def _line(kind: str, left: str, right: str, places: dict[str, tuple[int, int]]) -> str:
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
