"""Step 2: the robot pivots and translates the tool; verdict of a calibration (steps 2, 3)."""

from collections.abc import Iterable
from typing import Any

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.overview.acceptance import QualityRow
from rona_core.app.steps.tool.calibration_view import CalibrationView, Step, calibration_view
from rona_core.app.steps.tool.derivation import delay_words
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.step_panel import StepPanel, rows_of
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import escape

VERDICTS = {  # verdict -> (icon, words, colour, box)
    "good": ("✔", "good", "#00694d", "good"),
    "weak": ("▲", "weak", "#a34700", "warn"),
    "bad": ("✖", "bad", "#b00020", "warn"),
}


class CalibrationWords:
    """Expected errors and verdict of a calibration; poses and motion stand in the right dock."""

    def __init__(self, gui: Any, step: Step) -> None:
        self._step: Step = step
        self._words = gui.add_html("")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the calibration."""
        if changed(old, new, "session", "figures", "judged", "steps"):
            view, stale = calibration_view(new.session, self._step), new.step(self._step).state
            shown = () if view is None else rows_of(new)
            self._words.content = "" if view is None else words(view, shown, stale == "stale")


def words(view: CalibrationView, judged: Iterable[QualityRow], stale: bool = False) -> str:
    """Return the expected errors beside their limits, the verdict, and reasons with remedies.

    Those of a stale calibration have a value, and no verdict.
    """
    head = ("Error (3D, 1 σ)", "Value", "Limit", "")
    found = {row.key: row for row in judged}
    rows = [
        (
            escape(one.title),
            f"<b>{found[one.key].value_words or FIGURES[one.key].words(one.sigma_mm)}</b>",
            found[one.key].limit_words,
            style.verdict(found[one.key].verdict),
        )
        for one in view.expected
    ]
    icon, word, color, box = VERDICTS[view.verdict]
    box = "" if stale and box == "good" else box
    verdict = f'<b style="color:{color}">{icon} {word}</b>'
    reasons = "".join(f"<br>{escape(style.sentence(reason))}." for reason in view.reasons)
    note = f'<div class="r-note {box}">Calibration: {verdict}{reasons}</div>'
    return style.table(("", "n", "n g", ""), head, rows) + note


class ToolPanel(StepPanel):
    """Parameters of the tool motion and what came of it."""

    step = "tool"
    activity = "StartToolCapture"
    explanation = (
        "The robot pivots the tool about its tip and translates it along x and y while the "
        "tracker records the tool marker."
    )
    start = "Move and register the tool"

    def build_result(self) -> None:
        """Add what the calibration is worth."""
        self._calibration = CalibrationWords(self.gui, "tool")

    def build(self) -> None:
        """Add the parameters of the motion."""
        self.form.of(StartToolCapture)

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Show what the calibration is worth."""
        self._calibration.render(old, new)

    def message(self) -> Any:
        """Return the capture with these parameters."""
        return StartToolCapture(**self.form.values())

    def remarks(self, snapshot: Snapshot) -> str:
        """Say what was found."""
        derived = snapshot.session.results.tool
        if derived is None:
            return ""
        x, y, z = derived.value.T_toolmarker_tip.translation
        words = f"Tip at ({x:.2f}, {y:.2f}, {z:.2f}) mm in the tool marker."
        if derived.value.delay is not None:
            words += " {}: {}.".format(*delay_words(derived.value.delay))
        return style.text(words)
