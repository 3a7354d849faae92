"""HTML helpers of the docks; all text is escaped here. Their classes: ``static/docks.css``."""

from collections.abc import Iterable, Sequence

from rona_ui.presentation.colors import viridis_css
from rona_ui.viewer.bindings import escape

INK, MUTED, LINE = "#1f2933", "#52606d", "#d9dee4"
STATES = {  # state -> (icon, word, colour); text, icon and colour together
    "done": ("✔", "done", "#00694d"),
    "partial": ("◐", "partial", "#a34700"),
    "ready": ("▶", "ready", "#005b8f"),
    "blocked": ("–", "blocked", "#5f6b76"),
    "stale": ("!", "stale", "#a34700"),
}
JUDGING = ("…", "judging", MUTED)  # of a step whose figures are being computed
VERDICTS = {
    "pass": ("✔", "pass", "#00694d"),
    "review": ("▲", "review", "#a34700"),
    "fail": ("✖", "fail", "#b00020"),
    "none": ("", "", MUTED),
}
BOXES = {  # state of a judgement -> kind of note
    "usable": "good",
    "weak": "",
    "missing": "",
    "stale": "warn",
    "blocked": "warn",
    "bad": "warn",
}


def tag(name: str, text: object, css_class: str = "") -> str:
    """Return an element with escaped text."""
    kind = f' class="{escape(css_class)}"' if css_class else ""
    return f"<{name}{kind}>{escape(text)}</{name}>"


def note(text: object, kind: str = "") -> str:
    """Return a boxed remark; ``kind`` is empty, ``warn`` or ``good``."""
    return tag("div", text, f"r-note {kind}".strip()) if text else ""


def text(words: object) -> str:
    """Return a paragraph."""
    return tag("div", words, "r-text")


def key(entries: tuple[tuple[str, str], ...]) -> str:
    """Return a legend: colour and word for each entry."""
    items = (
        f'<span><i style="background:{escape(color)}"></i>{escape(word)}</span>'
        for color, word in entries
    )
    return f'<div class="r-key">{"".join(items)}</div>'


def verdict(kind: str) -> str:
    """Return icon, word and colour of a verdict."""
    icon, word, color = VERDICTS[kind]
    return f'<span style="color:{color};white-space:nowrap">{icon} {word}</span>'


def sentence(words: str) -> str:
    """Return words with a capital letter first."""
    return words[:1].upper() + words[1:]


def table(classes: Sequence[str], head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of HTML cells.

    Args:
        classes: CSS class of each column: ``n`` for numbers, ``g`` for grey, empty for text.
        head: Title of each column; none for a table without a head.
        rows: Cells of each row.
    """
    lines = [_row("th", classes, head)] if head else []
    lines += [_row("td", classes, row) for row in rows]
    return f'<table class="r-table">{"".join(lines)}</table>'


def _row(cell: str, classes: Sequence[str], contents: Sequence[str]) -> str:
    marks = (f' class="{name}"' if name else "" for name in classes)
    cells = (f"<{cell}{mark}>{c}</{cell}>" for mark, c in zip(marks, contents, strict=True))
    return f"<tr>{''.join(cells)}</tr>"


def color_bar(title: str, *ticks: str, gradient: str | None = None) -> str:
    """Return a colour bar, that of viridis if not said, with a title above and ticks below."""
    marks = "".join(f"<span>{tick}</span>" for tick in ticks)
    return (
        f'<div class="r-text" style="padding-bottom:2px">{title}</div>'
        f'<div class="r-bar" style="background:{gradient or viridis_css()}"></div>'
        f'<div class="r-ticks">{marks}</div>'
    )
