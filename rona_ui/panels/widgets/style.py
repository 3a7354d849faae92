"""Style sheet of the docks and HTML helpers; all text is escaped here."""

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
VERDICTS = {
    "pass": ("✔", "pass", "#00694d"),
    "review": ("▲", "review", "#a34700"),
    "fail": ("✖", "fail", "#b00020"),
    "none": ("", "", MUTED),
}
BOXES = {"good": "good", "weak": "", "bad": "warn", "stale": "warn"}  # state -> kind of note

SHEET = """<style>
:root,[data-mantine-color-scheme]{--mantine-primary-color-filled:#005b8f!important;
 --mantine-primary-color-filled-hover:#004a75!important;
 --mantine-primary-color-light-color:#005b8f!important}
.mantine-ButtonGroup-group button,.mantine-Button-root[data-variant=outline]{
 color:#005b8f!important;border-color:#9fb6c6!important}
[data-dock-tab]{padding:0 .55em!important}
[data-dock-tab]>div:first-child:has(svg){display:none!important}
.mantine-Tabs-tab[data-active]{color:#005b8f!important;border-color:#005b8f!important}
.mantine-Button-root[style*="gray-filled"]:not([disabled]){background:#fff!important;
 color:#005b8f!important;border:1px solid #9fb6c6!important}
.mantine-Button-root[style*="gray-filled"]:not([disabled]):hover{background:#eef4f8!important}
.mantine-Checkbox-input:checked{background:#005b8f!important;border-color:#005b8f!important}
.mantine-Text-root:has(>label){color:#3e4c59!important;letter-spacing:-.5px!important}
.mantine-Flex-root:not(:has(.mantine-NumberInput-root:nth-child(3)))>div:first-child:has(
 >.mantine-Text-root>label){width:8.6em!important}
.mantine-Notification-description{color:#3e4c59!important}
.mantine-Paper-root:has(>.mantine-Paper-root:first-child+div+div){padding:0!important;
 margin-top:6px!important;margin-bottom:8px!important;border-color:#d9dee4;border-radius:5px;
 overflow:hidden}
.mantine-Paper-root>.mantine-Paper-root:first-child:has(+div+div){position:static!important;
 transform:none!important;padding:4px 10px!important;border-radius:0;background:#f1f4f7;
 color:#1f2933;display:flex;justify-content:space-between;align-items:center}
.mantine-Paper-root>.mantine-Paper-root:first-child:hover:has(+div+div){background:#e7edf2}
.mantine-Paper-root>.mantine-Paper-root:first-child+div+div{display:none!important}
.r-head{display:flex;align-items:baseline;gap:10px;padding:2px 12px 6px;color:#1f2933}
.r-head b{font-size:15px;flex:1;overflow:hidden;text-overflow:ellipsis;white-space:nowrap}
.r-head span{font-size:12.5px;white-space:nowrap}
.r-step{height:33px;display:grid;grid-template-columns:22px minmax(0,1fr) auto;column-gap:6px;
 align-items:center;padding:0 12px;border-left:4px solid transparent;color:#1f2933}
.r-step.on{background:#e7f0f7;border-left-color:#005b8f}
.r-step .i{font-size:13px;text-align:center}.r-step .t{font-size:13px;line-height:1.15}
.r-step .s{display:block;font-size:11px;color:#52606d;white-space:nowrap;overflow:hidden;
 text-overflow:ellipsis}
.r-step .v{font-size:11px;white-space:nowrap}
.r-badge{font-size:11px;color:#fff;border-radius:4px;padding:1px 7px}
div:has(>.r-step)+div:has(>button){height:33px;margin:-33px 0 0!important;padding:0!important;
 position:relative;z-index:2}
div:has(>.r-step)+div>button{height:33px!important;background:transparent!important;
 border:0!important;border-radius:0;color:transparent!important}
div:has(>.r-step)+div>button:hover{background:rgba(0,91,143,.07)!important}
div:has(>.r-step)+div>button:focus-visible{outline:2px solid #005b8f;outline-offset:-2px}
.r-title{padding:10px 12px 2px;font-weight:650;font-size:14px;color:#1f2933;
 border-top:1px solid #d9dee4;margin-top:6px}
.r-text{padding:0 12px 8px;font-size:12.5px;line-height:1.45;color:#3e4c59}
.r-note{margin:0 12px 8px;padding:6px 9px;border-radius:5px;font-size:12.5px;line-height:1.4;
 color:#1f2933;border-left:4px solid #005b8f;background:#eef4f8}
.r-note.warn{border-left-color:#d55e00;background:#fdf1e7}
.r-note.good{border-left-color:#009e73;background:#e8f5f0}
.r-table{border-collapse:collapse;width:calc(100% - 16px);margin:4px 8px 10px;font-size:12.5px;
 color:#1f2933}
.r-table th{font-size:11px;font-weight:600;color:#52606d;text-align:left;padding:6px 6px 3px;
 border-bottom:1px solid #d9dee4}
.r-table td{padding:4px 5px;border-bottom:1px solid #eef1f4;vertical-align:top}
.r-table .n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
.r-table .g{color:#52606d}.r-table tr.sec td{font-weight:650;padding-top:10px;color:#3e4c59;
 font-size:11.5px;text-transform:uppercase;letter-spacing:.04em}
.r-bar{height:12px;border-radius:3px;margin:2px 12px 1px}
.r-ticks{display:flex;justify-content:space-between;margin:0 12px 8px;font-size:11px;color:#3e4c59}
.r-key{display:flex;flex-wrap:wrap;gap:4px 12px;padding:2px 12px 8px;font-size:12px;color:#3e4c59}
.r-key i{display:inline-block;width:11px;height:11px;border-radius:2px;margin-right:5px;
 vertical-align:-1px}
.r-log{padding:4px 12px;font-size:12px;color:#1f2933}
.r-log div{padding:3px 0;border-bottom:1px solid #eef1f4;overflow-wrap:anywhere}
.r-log span{color:#52606d}
</style>"""


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


def color_bar(title: str, *ticks: str) -> str:
    """Return the colour bar of viridis with a title above it and ticks below."""
    marks = "".join(f"<span>{tick}</span>" for tick in ticks)
    return (
        f'<div class="r-text" style="padding-bottom:2px">{title}</div>'
        f'<div class="r-bar" style="background:{viridis_css()}"></div>'
        f'<div class="r-ticks">{marks}</div>'
    )
