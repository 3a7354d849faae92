"""Verification on landmarks in step 8: the table, the gate, and its override with a reason."""

from typing import Any

from rona_core.app.steps.scan.landmarks.messages import (
    OverrideLandmarks,
    StartLandmarkCapture,
)
from rona_core.app.steps.scan.landmarks.view import LandmarkReport, landmark_report
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import escape

BOX = {"passed": "good", "failed": "warn", "overridden": "warn", "stale": "warn", "missing": ""}


class LandmarkControls:
    """A button that verifies, what came of it, and a field for the reason of an override."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._found = gui.add_html("")
        self._verify = context.send_button(
            gui, "Verify on landmarks", "map-pin-check", StartLandmarkCapture
        )
        self._reason = gui.add_text("Reason", "", visible=False)
        self._override = context.send_button(
            gui,
            "Override verification",
            "alert-triangle",
            lambda: OverrideLandmarks(self._reason.value),
            visible=False,
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Say how the verification stands, and what can be done."""
        for control in (self._verify, self._reason, self._override):
            control.disabled = new.busy
        if not changed(old, new, "session"):
            return
        report = landmark_report(new.session)
        results = new.session.results
        self._verify.visible = results.tool is not None and results.pointer is not None
        self._reason.visible = self._override.visible = report.state == "failed"
        self._found.content = landmark_note(report)


WORDS = {
    "missing": "Not verified on landmarks yet: the scan verifies first.",
    "passed": "Verified on landmarks.",
    "failed": "Verification on landmarks failed: the robot must not scan.",
    "overridden": "Verification on landmarks overridden.",
    "stale": "To be verified on landmarks again: the scan does it first.",
}


def landmark_note(report: LandmarkReport) -> str:
    """Return the verification as HTML: the verdict, and distance and expectation of each."""
    sentence = "" if report.state in ("missing", "stale") else f" {report.sentence}"
    passed_weakly = report.state == "passed" and report.contradicted
    box = "warn" if passed_weakly else BOX[report.state]
    words = style.note(WORDS[report.state] + sentence, box)
    if report.state == "missing" or not report.rows:
        return words
    rows = [
        (escape(row.name), _mm(row.distance_mm), _mm(row.sigma_mm), _mm(row.limit_mm))
        for row in report.rows
    ]
    rows.append(("all (RMS)", _mm(report.rms_mm), _mm(report.sigma_mm), ""))
    head = ("Landmark", "Off (mm)", "Expected", "Limit")
    return words + style.table(("", "n", "n", "n"), head, rows)


def _mm(length_mm: float | None) -> str:
    return "–" if length_mm is None else f"{length_mm:.2f}"
