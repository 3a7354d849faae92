"""Step 8: the robot executes the certified plan while the probe records; force control."""

from dataclasses import asdict
from typing import Any

import numpy as np

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import blocked, judge_part
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.maps.growing_map import GrowingMap
from rona_core.app.steps.scan.landmarks.messages import OverrideLandmarks, StartLandmarkCapture
from rona_core.app.steps.scan.landmarks.view import LandmarkReport, landmark_report
from rona_core.app.steps.scan.messages import (
    CalibrateProbeMounting,
    StartProbeMountingCapture,
    StartQuickLook,
    StartScan,
)
from rona_core.app.steps.scan.step import mounting_words, probe_advice
from rona_core.app.steps.scan.view import (
    ForceCurve,
    contact_report,
    delay_sentence,
    force_curve,
    head_report,
    live_force,
    unwatched,
)
from rona_core.app.steps.setup.messages import SetContact
from rona_core.geometry.arrays import Floats
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, SettingsForm, on_change
from rona_ui.panels.widgets.graphs import Axis, Graph
from rona_ui.panels.widgets.step_panel import ExportFolder, JudgementNote, LoadFolder, StepPanel
from rona_ui.presentation.colors import CATEGORIES, GREEN, SKY, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot, changed, shown_growing_map
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


ACROSS = {"Path (mm)": "path", "Time (s)": "time"}
FILLS = {  # state -> colour of its background
    "approach": "rgba(86,180,233,0.25)",
    "lost": "rgba(213,94,0,0.35)",
    "retract": "rgba(138,151,165,0.25)",
    "stopped": "rgba(176,0,32,0.35)",
}
EMPTY = "The force appears during the scan (step 8)."
LEAST_N = 1.5  # above the set point, that the graph shows
LINE = {"points": {"show": False}}
LIMIT = {"stroke": css(VERMILLION), "width": 1, "dash": (5, 4), **LINE}
SERIES = (
    *(
        {"label": w, "stroke": "transparent", "width": 0, "fill": c, **LINE}
        for w, c in FILLS.items()
    ),
    {"label": "set point", "stroke": css(GREEN), "width": 1, **LINE},
    {"label": "soft limit", **LIMIT},
    {"label": "stop", **LIMIT},
    {"label": "force", "stroke": css(CATEGORIES[0]), "width": 1.5, **LINE},
)


class ForcePanel:
    """A graph of the force with set point, limits and the states of the force loop."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        across = gui.add_dropdown("Horizontal axis", tuple(ACROSS))
        self._words = gui.add_html(style.text(EMPTY))
        self._graph = Graph(gui, 215)
        on_change(across, lambda e: context.set_view(force_across=ACROSS[across.value]))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the scan; while the robot scans, the newest seconds."""
        live = new.live.force if new.scanning else None
        seen = ("session.captures.scan", "session.setup", "view.force_across", "scanning")
        if not changed(old, new, *seen, *(("live.force",) if live is not None else ())):
            return
        if live is not None:
            curve, words = live_force(new.session, live), ""
        else:
            curve, report = (
                force_curve(new.session, new.view.force_across),
                contact_report(new.session),
            )
            words = EMPTY if report is None else report.sentence
        if curve is None:
            self._words.content = style.text(words)
            self._graph.clear()
            return
        x, y = graph_axes(curve)
        self._graph.show(x, y, force_data(curve), ({"label": curve.axis}, *SERIES))
        last = f"Now {curve.force_n[-1]:.1f} N, {curve.states[-1]}." if live is not None else words
        self._words.content = style.text(last) + style.key(force_key(curve))


def graph_axes(curve: ForceCurve) -> tuple[Axis, Axis]:
    """Return axes that show all of the force, and limits where they come near."""
    high = max(float(curve.force_n.max()), curve.setpoint_n) + LEAST_N
    low = min(-0.5, float(curve.force_n.min()) - 0.2)  # an unloaded sensor reads about zero
    start = float(curve.at[0])
    return (
        Axis(curve.axis, start, max(float(curve.at[-1]), start + 1e-3)),
        Axis("force (N)", float(np.floor(2.0 * low)) / 2.0, float(np.ceil(high))),
    )


def force_data(curve: ForceCurve) -> tuple[Floats, ...]:
    """Return the columns: place or time, a background for each state, set point, limits, force."""
    ones, high = np.ones(len(curve.at)), graph_axes(curve)[1].high
    states = np.array(curve.states)
    backs = [np.where(states == word, high, 0.0) for word in FILLS]  # filled down to zero
    beyond = high + 1.0  # limits that the graph does not reach are drawn above it
    limits = [ones * (beyond if v is None else v) for v in (curve.monitor_n, curve.stop_n)]
    return (curve.at, *backs, curve.setpoint_n * ones, *limits, curve.force_n)


def force_key(curve: ForceCurve) -> tuple[tuple[str, str], ...]:
    """Return colours and words of what is to be seen."""
    high_n = graph_axes(curve)[1].high
    limits = ((curve.monitor_n, "soft limit"), (curve.stop_n, "hard limit"))
    words = ", ".join(f"{word} {at:.0f} N" for at, word in limits if at is not None and at < high_n)
    seen = [(css(CATEGORIES[0]), "force"), (css(GREEN), "set point")]
    seen += [(css(VERMILLION), words)] if words else []
    return tuple(seen + [(color, word) for word, color in FILLS.items() if word in curve.states])


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


class QuickLookFields:
    """Quick look with each probe, and which one it advises."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        gui.add_html(
            style.text(
                "Short lines over the path with each probe by hand, upright and tilted, tell "
                "before the scan how far each would map the inner boundary."
            )
        )
        self._look = context.send_button(gui, "Quick look", "eye", StartQuickLook)
        self._advice = gui.add_html("")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the quick look."""
        if not changed(old, new, "session", "busy"):
            return
        self._look.disabled = new.busy or blocked(StartQuickLook, new.session) is not None
        self._advice.content = quick_look_note(new.session)


def quick_look_note(session: Session) -> str:
    """Return what the quick look says as HTML; empty without one."""
    advice, stale = probe_advice(session), stale_reason("quick_look", session)
    if advice is not None:
        return style.note(advice.sentence, "warn" if advice.another else "good")
    return "" if stale is None else style.note(f"Quick look: {stale}. Take it again.", "warn")


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


CAPTURES = (
    "All that was recorded in this session, with units and frames (captures.h5), and all "
    "transforms: as JSON, and for 3D Slicer (.tfm)."
)


class CaptureExportFolder(ExportFolder):
    """Files of what was recorded."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        names = tuple(one.name for one in REGISTRY.exports.values() if one.kind == "captures")
        super().__init__(
            gui, context, names, words=CAPTURES, button="Download captures", title="Export captures"
        )

    def render(self, new: Snapshot) -> None:
        """Offer the files once something was recorded."""
        self.show(there=bool(new.session.archive))


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
        with self.gui.add_folder("Which probe", expand_by_default=False):
            self._look = QuickLookFields(self.gui, self.context)
        self._load = LoadFolder(self.gui, self.context, "captures")
        self._export = CaptureExportFolder(self.gui, self.context)

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Show how the probe is mounted, and pressed on."""
        self._landmarks.render(old, new)
        self._contact.render(old, new)
        self._mounting.render(old, new)
        self._look.render(old, new)
        self._load.render(new)
        self._export.render(new)
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
