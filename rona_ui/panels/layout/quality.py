"""Quality table: figures versus ground truth with their limits, and predicted errors."""

from typing import Any

from rona_core.app.dependencies.step_states import StepState
from rona_core.app.overview.acceptance import (
    WORST_FIRST,
    QualityRow,
    pending_figures,
    quality_table,
)
from rona_core.app.steps.acoustics.view import thickness_shares
from rona_core.app.steps.scan.contact_view import contact_report
from rona_core.app.steps.tool.derivation import delay_words
from rona_core.session.document import Session
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
            stale = frozenset(step.name for step in new.steps if step.state == "stale")
            own = new.step(new.view.step)
            words = table(rows_of(new), new.session, stale, own)
            self._html.content = pending_note(new) + words


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


def table(
    rows: tuple[QualityRow, ...],
    session: Session,
    stale: frozenset[str],
    active: StepState | None = None,
) -> str:
    """Return the figures that have a value, by section; it says which steps are stale.

    Above it stands how many fail, are for review and pass. Figures of the active step come first,
    and in each section those that fail. Those of stale results are left out.
    """
    found, own = quality_table(rows), "" if active is None else active.name
    mark = _mark(not stale.isdisjoint(("tool", "pointer", "surface")))
    predicted = [row for row in found.predicted if row.step != own]
    body = _predicted_rows(session, predicted, mark)
    first: list[Pair] = [(row, None) for row in found.predicted if row.step == own]
    for part in found.sections:
        others = [pair for pair in part.rows if pair[0].step != own]
        first += [pair for pair in part.rows if pair[0].step == own]
        words = f"{part.title}, versus ground truth{_mark(bool(part.left_out))}"
        if others or part.left_out:
            body += _section(words) + _rows(others) + _left_out(part.left_out)
    if active is not None and first:
        title = f"Step {active.number}: {active.title}{_mark(own in stale)}"
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
    title, value = escape(row.title), f"<b>{_value(row)}</b>"
    if expected is not None:
        title += f'<br><span class="g">predicted {_value(expected)}</span>'
    if row.reason:
        title += f'<br><span class="g">{escape(row.reason)}</span>'
    if row.limit is not None:
        sign = "≤" if row.sense == "at most" else "≥"
        limit = f"{sign} {row.limit:.{row.decimals}f} {row.unit}".rstrip()
        value += f'<br><span class="g">{limit}</span>'
    return (
        f'<tr><td>{title}</td><td class="n">{value}</td><td>{style.verdict(row.verdict)}</td></tr>'
    )


def _value(row: QualityRow) -> str:
    if isinstance(row.value, bool) or not isinstance(row.value, int | float):
        return escape(row.value)
    return escape(f"{row.value:.{row.decimals}f} {row.unit}".strip())


def _predicted_rows(session: Session, expected: list[QualityRow], mark: str) -> str:
    """Return the predicted errors, without ground truth; mere residuals come last."""
    results, report, shares = session.results, contact_report(session), thickness_shares(session)
    lines: list[tuple[str, str]] = []
    if results.tool is not None:
        tool = results.tool.value
        if tool.delay is not None:
            lines.append(delay_words(tool.delay))
    if report is not None and report.delay is not None:
        late = report.delay
        latency = f"{late.delay_ms:.1f} ± {max(late.sigma_ms, 0.1):.1f} ms"
        shift = f"{late.uncorrected_mm:.2f} → {late.left_mm:.3f} mm"
        lines.append(("Robot-tracker latency at the scan", latency))
        lines.append(("Map shift by latency, before → after", shift))
    if results.registration is not None:
        lines.append(("Loaded skull, residual (RMS)", _mm(results.registration.value.rms_mm)))
    if results.pointer is not None:
        lines.append(("Pointer tip, residual (RMSE)", _mm(results.pointer.value.rmse_mm)))
    if shares is not None:
        speed = f"calibrated at {shares.points}" if shares.points else "published"
        lines += [
            ("Thickness, σ by the time of flight", _mm(shares.timing_mm)),
            (f"… by patient-specific speed ({speed})", _mm(shares.patient_mm)),
            ("… by local speed variation", _mm(shares.place_mm)),
            ("… by inner-table inclination", _mm(shares.wedge_mm)),
        ]
    rows = _rows([(row, None) for row in expected])
    rows += "".join(
        f'<tr><td>{escape(title)}</td><td class="n" colspan="2"><b>{escape(value)}</b></td></tr>'
        for title, value in lines
    )
    if not rows:
        return ""
    return _section(f"Predicted, without ground truth{mark}") + rows


def _mm(value_mm: float) -> str:
    return f"{value_mm:.2f} mm"
