"""Building blocks of a page: HTML that escapes what is not HTML already, and its style sheet."""

import html
from collections.abc import Iterable, Sequence

# the page may draw itself and nothing else: no script, no network
POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
    "form-action 'none'"
)
VERDICTS = {  # text and icon, not colour alone
    "pass": "✔ pass", "review": "▲ review", "fail": "✖ fail", "none": "",
    "done": "✔ done", "partial": "◐ partial", "stale": "! stale", "ready": "not done",
    "blocked": "not done", "good": "✔ good", "weak": "▲ weak", "bad": "✖ bad",
}  # fmt: skip
STYLE = """
:root{color-scheme:light dark;--ink:#1b2530;--soft:#5a6774;--line:#d8dee5;--page:#fff;--box:#f5f7f9;
--brand:#005b8f;--good:#00694d;--warn:#a34700;--bad:#b00020;--bone:#e2d9c6;--band:#0072b2}
@media screen and (prefers-color-scheme:dark){:root{--ink:#e6ebf0;--soft:#a3b0bc;--line:#37424d;
--page:#151b21;--box:#1e262e;--brand:#6bb8ea;--good:#4fcf9f;--warn:#f0a35a;--bad:#ff8a94;
--bone:#5a5242;--band:#56b4e9}}
@media print{:root{color-scheme:light}}
*{box-sizing:border-box}
body{margin:0 auto;padding:28px 32px 40px;max-width:1020px;background:var(--page);color:var(--ink);
font:14px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif;
font-variant-numeric:tabular-nums;overflow-wrap:break-word}
header{border-bottom:3px solid var(--brand);padding-bottom:12px;margin-bottom:18px}
.kind{color:var(--brand);font-weight:700;letter-spacing:.08em;text-transform:uppercase;font-size:12px}
h1{font-size:27px;line-height:1.2;margin:2px 0 8px}
h2{font-size:18px;margin:30px 0 8px;padding-bottom:4px;border-bottom:1px solid var(--line);
break-after:avoid}
h3{font-size:14px;margin:18px 0 6px;break-after:avoid}
p{margin:6px 0 10px}
.soft,figcaption,small{color:var(--soft)}
.tiles{display:grid;grid-template-columns:repeat(4,1fr);gap:12px;margin:14px 0}
.tile{background:var(--box);border:1px solid var(--line);border-radius:8px;padding:11px 13px;
break-inside:avoid}
.tile b{display:block;font-size:22px;line-height:1.25;margin:2px 0}
.tile span{color:var(--soft);font-size:12px;display:block}
dl{display:grid;grid-template-columns:max-content 1fr max-content 1fr;gap:3px 18px;margin:8px 0}
dt{color:var(--soft)}dd{margin:0}
table{border-collapse:collapse;width:100%;margin:6px 0 12px;font-size:13px}
th{text-align:left;color:var(--soft);font-weight:600;border-bottom:1.5px solid var(--line);
vertical-align:bottom}
th,td{padding:4px 12px 4px 0}
td{border-bottom:1px solid var(--line);vertical-align:top;overflow-wrap:anywhere}
tr{break-inside:avoid}
tbody tr:nth-child(-n+2){break-after:avoid}tbody tr:nth-last-child(-n+2){break-before:avoid}
.n{text-align:right;white-space:nowrap}
th.n{width:112px}th.n.own,.halves th.n{width:auto}
.name{white-space:nowrap}
td.v,th.v{white-space:nowrap;width:84px}
.verdict{font-weight:600;white-space:nowrap;color:var(--soft)}
.verdict:is(.pass,.done,.good){color:var(--good)}.verdict:is(.fail,.bad){color:var(--bad)}
.verdict:is(.review,.partial,.weak,.stale){color:var(--warn)}
.note{border-left:4px solid var(--line);background:var(--box);padding:7px 12px;margin:8px 0;
border-radius:0 6px 6px 0;break-inside:avoid}
.note.warn{border-color:var(--warn)}.note.good{border-color:var(--good)}
.maps{display:grid;grid-template-columns:repeat(3,1fr);gap:18px}
.two{display:grid;grid-template-columns:3fr 2fr;gap:18px}
.halves{display:grid;grid-template-columns:1fr 1fr;gap:26px}
figure{margin:8px 0}figure,.maps,.two,.halves{break-inside:avoid}
figcaption{font-size:12px;margin-top:2px}
svg{display:block;width:100%;height:auto}
svg text{fill:var(--soft);font-size:11px}
svg .frame{fill:none;stroke:var(--soft);stroke-width:.8}
svg .tick{stroke:var(--line);stroke-width:.8}
svg .title{fill:var(--ink);font-size:12.5px;font-weight:600}
code{font:12px ui-monospace,SFMono-Regular,Menlo,Consolas,monospace}
footer{margin-top:18px;break-before:avoid;border-top:1px solid var(--line);padding-top:8px;
color:var(--soft);font-size:12px}
@media (max-width:720px){body{padding:16px}.tiles{grid-template-columns:1fr 1fr}
.maps,.two,.halves{grid-template-columns:1fr}dl{grid-template-columns:max-content 1fr}}
@page{size:A4;margin:14mm 13mm}
@media print{body{padding:0;max-width:none;font-size:10.5pt}table{font-size:9pt}h1{font-size:20pt}
h2{font-size:13pt}.tile b{font-size:15pt}
th.n{width:78px}dl,h1{margin:4px 0}.tiles{margin:8px 0}.tile{padding:7px 9px}
*{-webkit-print-color-adjust:exact;print-color-adjust:exact}}
"""


class Html(str):
    """Text that is HTML already; all other text is escaped where it is put into a page."""

    __slots__ = ()


def markup(content: object) -> Html:
    """Return content as HTML: escaped, unless it is HTML."""
    return content if isinstance(content, Html) else Html(html.escape(str(content), quote=True))


def tag(name: str, *content: object, css: str = "") -> Html:
    """Return an element around some content."""
    kind = f' class="{markup(css)}"' if css else ""
    return Html(f"<{name}{kind}>{''.join(map(markup, content))}</{name}>")


def joined(parts: Iterable[object]) -> Html:
    """Return contents one after the other."""
    return Html("".join(map(markup, parts)))


def note(words: str, kind: str = "") -> Html:
    """Return a boxed remark; ``kind`` is empty, ``warn`` or ``good``. Nothing for no words."""
    return tag("div", words, css=f"note {kind}".strip()) if words else Html("")


def badge(kind: str) -> Html:
    """Return a verdict or a state as icon, word and colour."""
    return tag("span", VERDICTS[kind], css=f"verdict {kind}")


def table(
    head: Sequence[object], rows: Iterable[Sequence[object]], columns: Sequence[str] = ()
) -> Html:
    """Return a table.

    Args:
        head: Title of each column.
        rows: Cells of each row.
        columns: CSS class of each column: ``n`` for numbers (``n own``: as wide as they are),
            ``v`` for verdicts, ``name`` for names that stay in one line.
    """
    kinds = [*columns, *[""] * (len(head) - len(columns))]

    def line(cell: str, contents: Sequence[object]) -> Html:
        pairs = zip(contents, kinds, strict=True)
        return tag("tr", *(tag(cell, content, css=kind) for content, kind in pairs))

    body = tag("tbody", *(line("td", row) for row in rows))
    return tag("table", tag("thead", line("th", head)), body)


def facts(pairs: Iterable[tuple[str, object]]) -> Html:
    """Return names with their values, side by side."""
    return tag("dl", *(joined((tag("dt", name), tag("dd", value))) for name, value in pairs))


def tile(title: str, value: object, words: str) -> Html:
    """Return one figure in large letters."""
    return tag("div", tag("span", title), tag("b", value), tag("span", words), css="tile")


def whole_page(title: str, *content: object, policy: str = POLICY) -> str:
    """Return a page; what cannot be written in UTF-8 becomes a question mark.

    Args:
        title: Of its window.
        content: Of its body.
        policy: What it may load; by default it stands alone.
    """
    head = (
        '<meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{markup(policy)}">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"{tag('title', title)}<style>{STYLE}</style>"
    )
    text = f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head>\n{tag("body", *content)}</html>\n'
    return text.encode("utf-8", "replace").decode("utf-8")
