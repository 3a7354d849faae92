"""Step 8: the robot executes the certified plan while the probe records; force control."""

from dataclasses import asdict
from typing import Any

from rona_core.app.dependencies.judge import judge_part
from rona_core.app.steps.maps.growing_map import GrowingMap
from rona_core.app.steps.scan.messages import (
    CalibrateProbeMounting,
    StartProbeMountingCapture,
    StartScan,
)
from rona_core.app.steps.scan.step import mounting_words
from rona_core.app.steps.scan.view import contact_report, delay_sentence, head_report, unwatched
from rona_core.app.steps.setup.messages import SetContact
from rona_core.session.document import Session
from rona_ui.panels.scan.landmarks import LandmarkControls
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import SettingsForm
from rona_ui.panels.widgets.panel_context import PanelContext
from rona_ui.panels.widgets.step_panel import JudgementNote, StepPanel
from rona_ui.presentation.colors import GREEN, SKY, VERMILLION, css
from rona_ui.presentation.shown import shown_growing_map
from rona_ui.presentation.snapshot import Snapshot, changed

LIMITS = (
    "travel_mm",
    "monitor_n",
    "stop_n",
    "approach_mm_per_s",
    "period_ms",
    "delay_ms",
    "lag_ms",
)


def contact_form(gui: Any, context: PanelContext) -> SettingsForm:
    """Add the rows of ``SetContact``; the limits stay as they are where nothing is pressed on."""
    form = SettingsForm(
        gui,
        context,
        SetContact,
        lambda session: session.setup.devices.robot.contact,
        "pressed",
        "force_n",
        show=lambda held: {"pressed": False} if held is None else {"pressed": True, **asdict(held)},
    )
    with gui.add_folder("Contact limits", expand_by_default=False):
        form.add(*LIMITS)
    return form


def contact_note(session: Session) -> str:
    """Return force and latency of the last scan as HTML."""
    report = contact_report(session)
    if report is None:
        return ""
    ended = report.contact is not None and bool(report.contact.reason)
    words = style.note(report.sentence, "warn" if ended else "")
    if report.mass is not None:
        words += style.note(f"{report.mass}.", "warn")
    return words + (style.text(delay_sentence(report.delay)) if report.delay is not None else "")


def head_note(session: Session) -> str:
    """Return what the head did up to the scan and in it as HTML."""
    report = head_report(session)
    if report is None:
        return ""
    return style.note(report.sentence, "warn" if unwatched(session) is not None else "")


class MountingFields:
    """Calibration of the probe in its holder, on a gauge plate."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        gui.add_html(
            style.text(
                "A steel gauge plate at the holder measures where the face of the probe is and how "
                "fast its warm line is: before a scan, with the line as warm as in the scan. "
                "Without it the outer map is off by as much as the probe is."
            )
        )
        self._record = context.send_button(
            gui, "Record on gauge plate", "target", StartProbeMountingCapture
        )
        self._reset = context.send_button(
            gui, "Reset mounting", "restore", lambda: CalibrateProbeMounting(use=False)
        )
        self._found = JudgementNote(gui, context)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Say what is known of the mounting."""
        if not changed(old, new, "session", "busy"):
            return
        for button in (self._record, self._reset):
            button.disabled = new.busy
        words, found = mounting_words(new.session), judge_part("mounting", new.session)
        self._reset.visible = bool(words)
        self._found.show(words or "As drawn: not calibrated.", found, busy=new.busy)


def growing_bar(growing: GrowingMap | None) -> str:
    """Return the colour bar of the map that grows, and its components, as HTML."""
    if growing is None:
        return ""
    low, high = growing.low_mm, growing.high_mm
    ticks = (f"≤ {low:.1f}", f"{(low + high) / 2:.1f}", f"≥ {high:.1f}")
    words = (
        f"Outer boundary so far, in {growing.n_seen} of {growing.n_scans} A-scans. Step 9 maps it."
    )
    return style.color_bar("Height of the outer boundary (mm)", *ticks) + style.text(words)


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
        """Add how the probe is mounted, and pressed on."""
        self._growing = self.gui.add_html("")
        self._landmarks = LandmarkControls(self.gui, self.context)
        self._contact = contact_form(self.gui, self.context)
        with self.gui.add_folder("Probe mounting", expand_by_default=False):
            self._mounting = MountingFields(self.gui, self.context)

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Show how the probe is mounted, and pressed on."""
        self._landmarks.render(old, new)
        self._contact.render(old, new)
        self._mounting.render(old, new)
        growing = shown_growing_map(new)
        if old is None or shown_growing_map(old) is not growing:
            self._growing.content = growing_bar(growing)

    def message(self) -> Any:
        """Return the scan."""
        return StartScan()

    def remarks(self, snapshot: Snapshot) -> str:
        """Say what was recorded."""
        capture = snapshot.session.captures.scan
        if capture is None:
            return ""
        times_s = capture.scans.times_s
        span_s = times_s[-1] - times_s[0] if len(times_s) else 0.0
        words = f"{len(capture.scans)} A-scans in {span_s:.1f} s."
        pressed = contact_note(snapshot.session) + head_note(snapshot.session)
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
