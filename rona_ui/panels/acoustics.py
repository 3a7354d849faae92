"""Calibration of the speed of sound in step 9 at points of known thickness."""

from typing import Any

from rona_core.app.steps.acoustics.messages import (
    AddReferencePoint,
    CalibrateSoundSpeed,
    RemoveReferencePoint,
    StartCaliperMeasurements,
)
from rona_core.app.steps.acoustics.view import ReferenceRow, reference_rows, speed_state
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_click

KINDS = {"good": "good", "weak": "", "bad": "warn", "stale": "warn"}


class SpeedFields:
    """Fields to measure or enter reference points and to calibrate."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self._number = gui.add_number(
            "Number of points", 3, min=1, max=20, step=1, hint="Three are enough for most patients"
        )
        self._measure = gui.add_button("Measure with caliper", icon="ruler-measure", color="gray")
        self._scan = gui.add_number(
            "A-scan no.", 0, min=0, max=100000, step=1, hint="A-scan at the measured place"
        )
        self._thickness = gui.add_number("Thickness (mm)", 6.0, min=0.5, max=30.0, step=0.05)
        self._add = gui.add_button("Add point", icon="plus", color="gray")
        self._remove = gui.add_button("Remove last point", icon="minus", color="gray")
        self._calibrate = gui.add_button("Calibrate speed", icon="ruler-2", color="gray")
        self._html = gui.add_html("")
        on_click(self._measure, self._on_measure)
        on_click(self._add, self._on_add)
        on_click(self._remove, self._on_remove)
        on_click(self._calibrate, lambda e: context.send(CalibrateSoundSpeed, e))
        self._points = 0

    def _on_measure(self, event: Any) -> None:
        n = int(self._number.value)
        self._context.send(lambda: StartCaliperMeasurements(n=n), event)

    def _on_add(self, event: Any) -> None:
        scan, thickness_mm = int(self._scan.value), float(self._thickness.value)
        self._context.send(lambda: AddReferencePoint(thickness_mm, scan=scan), event)

    def _on_remove(self, event: Any) -> None:
        last = self._points - 1
        self._context.send(lambda: RemoveReferencePoint(last), event)

    def show(self, session: Session, busy: bool) -> None:
        """Follow the session."""
        rows, state = reference_rows(session), speed_state(session)
        self._points = len(rows)
        mapped = session.results.detection is not None
        for button in (self._measure, self._add):
            button.disabled = busy or not mapped
        self._remove.visible = self._calibrate.visible = bool(rows)
        self._remove.disabled = self._calibrate.disabled = busy
        html = points_table(rows)
        if state is not None:
            html += style.note(f"Speed of sound {state.sentence}", KINDS[state.verdict])
        elif not mapped:
            html += style.note("Map the boundaries first, then measure with the caliper.")
        else:
            html += style.note("Not calibrated: published speed, ± 3 % between patients.")
        self._html.content = html


def points_table(rows: tuple[ReferenceRow, ...]) -> str:
    """Return the reference points: caliper, what ultrasound is off, own speed."""
    if not rows:
        return ""
    body = ""
    for row in rows:
        off = "" if row.off_mm is None else f"{row.off_mm:+.2f}"
        speed = "" if row.speed_mm_per_us is None else f"{row.speed_mm_per_us:.2f}"
        mark = "" if row.counts else ' <span style="color:#a34700">! doubtful</span>'
        body += (
            f'<tr><td>{row.number + 1}{mark}</td><td class="n">{row.caliper_mm:.2f}</td>'
            f'<td class="n">{off}</td><td class="n">{speed}</td></tr>'
        )
    return (
        '<table class="r-table"><tr><th>Point</th><th class="n">Caliper (mm)</th>'
        '<th class="n">Echo − caliper</th><th class="n">mm/µs</th></tr>'
        f"{body}</table>"
    )
