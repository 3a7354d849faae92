"""Certificate: all checks of the verifier with worst value, limit and place."""

from typing import Any

from rona_core.app.steps.roll.certificate_view import CertificateView, CheckPlace, certificate_view
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import escape

NOTHING = "The verification appears here once a motion is planned (step 7)."
NOWHERE = "Select a check"


class ChecksPanel:
    """A verdict, a choice that drives the replay to a check's worst place, and the whole list."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._words = gui.add_html(style.text(NOTHING))
        hint = "Moves the replay to the worst value of this check"
        self._choice = gui.add_dropdown("Go to worst", (NOWHERE,), visible=False, hint=hint)
        self._table = gui.add_html("")
        self._rows: dict[str, CheckPlace] = {}

        def go(event: Any) -> None:
            row = self._rows.get(self._choice.value)
            if row is not None:
                context.set_view(cursor=row.share, playing=False)
                context.set_camera("Probe" if row.path_percent is not None else "Robot")

        on_change(self._choice, go)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the plan."""
        if not changed(old, new, "session.results.roll", "steps"):
            return
        view = certificate_view(new.session)
        self._choice.visible = view is not None
        if view is None:
            self._words.content, self._table.content = style.text(NOTHING), ""
            return
        stale = new.step("roll").state == "stale"
        self._words.content = verdict(view, stale=stale)
        if changed(old, new, "session.results.roll"):
            self._rows = {
                ("✖ " if not row.check.holds else "") + row.check.name: row for row in view.rows
            }
            self._choice.options = (NOWHERE, *self._rows)
            self._choice.value = NOWHERE
            self._table.content = table(view)


def verdict(view: CertificateView, *, stale: bool) -> str:
    """Return the overall verdict; for a refusal with cause and place."""
    number = len(view.rows)
    if not view.certified:
        return style.note(refusal(view), "warn")
    if stale:
        return style.note(
            f"All {number} checks held, but inputs have changed since. Plan again.", "warn"
        )
    words = f"Verified: all {number} checks hold over {view.duration_s:.1f} s of motion."
    if view.min_clearance_mm is not None:
        words += f" Minimum clearance {view.min_clearance_mm:.1f} mm."
    return style.note(words, "good")


def refusal(view: CertificateView) -> str:
    """Return why and where the motion is refused."""
    failures = view.failures
    if not failures:
        return (
            "Refused: the certificate belongs to another motion, robot or tolerances. Plan again."
        )
    parts = "; ".join(f"{row.check.sentence} ({row.place})" for row in failures[:3])
    more = f"; and {len(failures) - 3} more" if len(failures) > 3 else ""
    return f"Refused: {parts}{more}. The robot will not execute it."


def refusal_in_short(view: CertificateView) -> str:
    """Return what is refused, for beside the plan."""
    names = ", ".join(
        f"{row.check.name} ({row.value_words}, {row.limit_words})" for row in view.failures[:3]
    )
    more = len(view.failures) - 3
    names += f" and {more} more" if more > 0 else ""
    return f"Refused: {names or 'another motion, robot or tolerances'}. See Checks on the right."


def table(view: CertificateView) -> str:
    """Return one row a check: name and place, worst value, limit, verdict."""
    rows = (
        (
            f'{escape(row.check.name)}<br><span class="g">{escape(row.place)}</span>',
            f'<b>{escape(row.value_words)}</b><br><span class="g">{escape(row.limit_words)}</span>',
            style.verdict("pass" if row.check.holds else "fail"),
        )
        for row in view.rows
    )
    return style.table(("", "n", ""), ("Check, where it is worst", "Value, limit", ""), rows)
