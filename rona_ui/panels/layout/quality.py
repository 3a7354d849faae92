"""Quality table: figures versus ground truth with their limits, and predicted errors."""

from typing import Any

from rona_core.app.dependencies.judge import StepState
from rona_core.app.overview.acceptance import (
    WORST_FIRST,
    QualityRow,
    pending_figures,
    quality_table,
)
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.step_panel import rows_of
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import escape

Pair = tuple[QualityRow, QualityRow | None]  # a figure, and what was predicted of it
MAX_PENDING = 6  # that are named


class QualityPanel:
    """A table: quantity, value with unit, limit, verdict; figures of the active step come first."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html(style.text("No figures yet: do the first steps."))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow figures, session and active step."""
        parts = ("figures", "judged", "computing", "session.results", "steps", "view.step")
        if changed(old, new, *parts):
            active = new.step(new.view.step)
            self._html.content = pending_note(new) + table(rows_of(new), active)


def pending_note(snapshot: Snapshot) -> str:
    """Return which figures with a limit are still to be computed, as HTML; empty where none are."""
    pending = pending_figures(snapshot.session, snapshot.judged)
    titles = [
        row.title
        for row in rows_of(snapshot)
        if row.key in pending and row.limit is not None and row.value is None
    ]
    if not titles or not (snapshot.computing or snapshot.busy):
        return ""
    words = "Computing" if snapshot.computing else "Computed after the running job"
    more = f" and {len(titles) - MAX_PENDING} more" if len(titles) > MAX_PENDING else ""
    return style.note(f"… {words}: {', '.join(titles[:MAX_PENDING])}{more}.")


def table(rows: tuple[QualityRow, ...], active: StepState | None = None) -> str:
    """Return the figures that have a value, by section; it says which steps are stale.

    Above it stands how many fail, are for review and pass. Figures of the active step come first,
    and in each section those that fail. Those of stale results are left out.
    """
    found, own = quality_table(rows), "" if active is None else active.name
    predicted: list[Pair] = [(row, None) for row in found.predicted if row.step != own]
    body = _section("Predicted, without ground truth") if predicted else ""
    body += _rows(predicted)
    first: list[Pair] = [(row, None) for row in found.predicted if row.step == own]
    for part in found.sections:
        others = [pair for pair in part.rows if pair[0].step != own]
        first += [pair for pair in part.rows if pair[0].step == own]
        words = f"{part.title}, versus ground truth{_mark(bool(part.left_out))}"
        if others or part.left_out:
            body += _section(words) + _rows(others) + _left_out(part.left_out)
    if active is not None and first:
        title = f"Step {active.number}: {active.title}{_mark(active.state == 'stale')}"
        body = _section(title) + _rows(first) + body
    if not body:
        return style.text(
            "No figures yet. Each step adds its own, with a limit and a verdict beside it."
        )
    head = '<tr><th>Quantity</th><th class="n">Value, limit</th><th>Verdict</th></tr>'
    return f'{counts(rows)}<table class="r-table">{head}{body}</table>'


def _section(words: str) -> str:
    return f'<tr class="sec"><td colspan="3">{words}</td></tr>'


def _rows(pairs: list[Pair]) -> str:
    """Return figures with what was predicted of them, those that fail first."""
    pairs = sorted(pairs, key=lambda pair: WORST_FIRST.index(pair[0].verdict))
    return "".join(_row(*pair) for pair in pairs)


def counts(rows: tuple[QualityRow, ...]) -> str:
    """Return how many figures fail, are for review and pass, as a line of HTML."""
    parts = [
        f"{style.verdict(kind)}: {n}"
        for kind in ("fail", "review", "pass")
        if (n := sum(row.verdict == kind for row in rows))
    ]
    left_out = sum(row.stale_reason is not None for row in rows)
    parts += [f"stale, left out: {left_out}"] if left_out else []
    return f'<div class="r-text">{"&ensp; ".join(parts)}</div>' if parts else ""


def _left_out(rows: tuple[QualityRow, ...]) -> str:
    """Return a line about figures of stale results: the truth is another one by now."""
    if not rows:
        return ""
    figures = "1 figure is" if len(rows) == 1 else f"{len(rows)} figures are"
    words = f"{figures} left out: {rows[0].stale_reason}"
    return f'<tr><td colspan="3" class="g">{escape(words)}</td></tr>'


def _mark(stale: bool) -> str:
    """Return a mark for figures of results that something earlier has changed since."""
    if not stale:
        return ""
    icon, word, color = style.STATES["stale"]
    return f' <span style="color:{color}">{icon} {word}</span>'


def _row(row: QualityRow, expected: QualityRow | None = None) -> str:
    title, value = escape(row.title), f"<b>{escape(row.value_words)}</b>"
    if expected is not None:
        title += f'<br><span class="g">predicted {escape(expected.value_words)}</span>'
    if row.reason:
        title += f'<br><span class="g">{escape(row.reason)}</span>'
    if row.limit is not None:
        value += f'<br><span class="g">{row.limit_words}</span>'
    return (
        f'<tr><td>{title}</td><td class="n">{value}</td><td>{style.verdict(row.verdict)}</td></tr>'
    )
