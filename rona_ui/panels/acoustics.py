"""Calibration of the speed of sound in step 9 at points of known thickness."""

from typing import Any

from rona_core.app.dependencies.judge import judge_part
from rona_core.app.steps.acoustics.messages import (
    AddReferencePoint,
    CalibrateSoundSpeed,
    RemoveReferencePoint,
    StartCaliperMeasurements,
)
from rona_core.app.steps.acoustics.view import (
    PUBLISHED_WORDS,
    ReferenceRow,
    gain_words,
    reference_gain,
    reference_rows,
    speed_words,
)
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form, PanelContext
from rona_ui.panels.widgets.step_panel import JudgementNote


class SpeedFields:
    """Fields to measure or enter reference points and to calibrate."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._points = 0
        count, point = Form(gui), Form(gui)
        count.of(StartCaliperMeasurements, "n")
        self._measure = context.send_button(
            gui,
            "Measure with caliper",
            "ruler-measure",
            lambda: StartCaliperMeasurements(**count.values()),
        )
        self._more = context.send_button(
            gui,
            "Measure more",
            "plus",
            lambda: StartCaliperMeasurements(**count.values(), append=True),
        )
        point.of(AddReferencePoint, "scan", "thickness_mm", scan=0, thickness_mm=6.0)
        self._add = context.send_button(
            gui, "Add point", "plus", lambda: AddReferencePoint(**point.values())
        )
        self._remove = context.send_button(
            gui, "Remove last point", "minus", lambda: RemoveReferencePoint(self._points - 1)
        )
        self._calibrate = context.send_button(
            gui, "Calibrate speed", "ruler-2", CalibrateSoundSpeed
        )
        self._table = gui.add_html("")
        self._found = JudgementNote(gui, context)
        self._gain = gui.add_html("")

    def show(self, session: Session, busy: bool) -> None:
        """Follow the session."""
        rows, words = reference_rows(session), speed_words(session)
        self._points = len(rows)
        mapped = session.results.detection is not None
        for button in (self._measure, self._more, self._add):
            button.disabled = busy or not mapped
        self._more.visible = self._remove.visible = self._calibrate.visible = bool(rows)
        self._remove.disabled = self._calibrate.disabled = busy
        if words:
            words = f"Speed of sound {words}"
        elif mapped:
            words = f"Not calibrated: published speed, {PUBLISHED_WORDS}."
        else:
            words = "Map the boundaries first, then measure with the caliper."
        found, gain = judge_part("speed", session), reference_gain(session)
        self._table.content = points_table(rows)
        self._found.show(words, found, busy=busy)
        promised = gain is not None and found.state != "usable"
        self._gain.content = style.note(gain_words(gain)) if promised and gain is not None else ""


def points_table(rows: tuple[ReferenceRow, ...]) -> str:
    """Return the reference points: caliper, what ultrasound is off, own speed."""
    if not rows:
        return ""
    cells: list[tuple[str, ...]] = []
    for row in rows:
        off = "" if row.off_mm is None else f"{row.off_mm:+.2f}"
        speed = "" if row.speed_mm_per_us is None else f"{row.speed_mm_per_us:.2f}"
        mark = "" if row.counts else ' <span style="color:#a34700">! doubtful</span>'
        cells.append((f"{row.number + 1}{mark}", f"{row.caliper_mm:.2f}", off, speed))
    head = ("Point", "Caliper (mm)", "Echo − caliper", "mm/µs")
    return style.table(("", "n", "n", "n"), head, cells)
