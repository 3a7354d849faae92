"""Step 8: the robot executes the certified plan while the probe records."""

from typing import Any

from rona_core.app.steps.scan.messages import StartScan
from rona_ui.panels.scan.contact import ContactFields, contact_note
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.colors import GREEN, SKY, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot


class ScanPanel(StepPanel):
    """One button; Stop is in the bar above and on the key Esc."""

    step = "scan"
    activity = "StartScan"
    explanation = (
        "The robot executes the verified plan while the probe records A-scans. Stop (Esc) "
        "halts the robot at once; recorded data are kept."
    )
    start = "Scan"

    def build(self) -> None:
        """Add how the probe is pressed on."""
        self._contact = ContactFields(self.gui, self.context)

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Show how the probe is pressed on."""
        self._contact.render(old, new)

    def message(self) -> Any:
        """Return the scan."""
        return StartScan()

    def remarks(self, snapshot: Snapshot) -> str:
        """Say what was recorded."""
        capture = snapshot.session.captures.scan
        if capture is None:
            return ""
        words = f"{len(capture.scans)} A-scans in {_span_s(capture):.1f} s."
        pressed = contact_note(snapshot.session)
        if capture.partial:
            words += " Stopped early: scan again, or the maps cover only this part."
            return style.note(words, "warn") + pressed
        legend = (
            (css(SKY), "recorded"),
            (css(GREEN), "inner boundary found"),
            (css(VERMILLION), "not found"),
        )
        recorded = style.note(words + " Replay them below.", "good")
        return recorded + style.key(legend) + pressed


def _span_s(capture: Any) -> float:
    times = capture.scans.times_s
    return float(times[-1] - times[0]) if len(times) else 0.0
