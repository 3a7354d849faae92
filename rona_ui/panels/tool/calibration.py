"""Calibration of steps 2 and 3: motion that was made, residual of each pose, poses left out."""

from typing import Any

from rona_core.app.steps.pointer.messages import ExcludePoses
from rona_core.app.steps.tool.calibration_view import (
    EXCLUDED,
    MARKS,
    REJECTED,
    USED,
    CalibrationView,
    Step,
    calibration_view,
)
from rona_ui.panels.tool.calibration_images import (
    GREY,
    HEIGHT,
    coverage_svg,
    residual_top_mm,
    residuals_svg,
)
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.image_slider import ImageSlider
from rona_ui.panels.widgets.panel_context import PanelContext, on_change, on_click
from rona_ui.presentation.colors import BLUE, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot, changed

STEPS: tuple[Step, ...] = ("tool", "pointer")
EMPTY = "Shows the motion and the residuals once this step is calibrated."


class CalibrationPanel:
    """The calibration of step 2 or 3: that of the step which was looked at last."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._words = gui.add_html(style.text(EMPTY))
        self._steps: dict[Step, tuple[Any, CalibrationControls]] = {}
        for step in STEPS:
            folder = gui.add_folder(None, visible=False)
            with folder:
                self._steps[step] = folder, CalibrationControls(gui, context, step)
        self._shown: Step = "tool"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the calibrations and the active step."""
        for step in STEPS:
            if step == new.view.step:
                self._shown = step
        state = new.step(self._shown)
        known = new.session.results.get(self._shown) is not None
        title = style.tag("div", f"Calibration of step {state.number}: {state.title}", "r-title")
        stale = style.note(f"Stale: {state.reason}.", "warn") if state.state == "stale" else ""
        self._words.content = title + (stale if known else style.text(EMPTY))
        for step, (folder, controls) in self._steps.items():
            folder.visible = known and step == self._shown
            controls.render(old, new)


class CalibrationControls:
    """Motion and residuals of a calibration; poses can be excluded or included."""

    def __init__(self, gui: Any, context: PanelContext, step: Step) -> None:
        self._context = context
        self._step: Step = step
        self._view: CalibrationView | None = None
        self._coverage = gui.add_html("")
        self._folder = gui.add_folder(None, visible=False)
        with self._folder:
            self._title = gui.add_html("")
            self._slider = ImageSlider(
                gui, f"r-{step}-poses", "Pose", int(HEIGHT), lambda e: self._show_pose()
            )
            self._pose = gui.add_html("")
            self._count = gui.add_number("Number of poses", 1, min=1, max=5000, step=1)
            self._toggle = gui.add_button("Exclude", icon="circle-minus", color="gray")
            on_click(self._toggle, self._change)
            self._all = context.send_button(
                gui, "Include all poses", "circle-check", lambda: ExcludePoses(step)
            )
        on_change(self._count, lambda e: self._show_pose())

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the calibration; rest while a job runs."""
        self._toggle.disabled = self._all.disabled = new.busy
        parts = (f"session.results.{self._step}", f"session.captures.{self._step}")
        if not changed(old, new, *parts):
            return
        view = self._view = calibration_view(new.session, self._step)
        self._folder.visible = view is not None
        self._coverage.content = "" if view is None else coverage(view)
        if view is None:
            return
        self._title.content = _residuals_title(view)
        last = max(len(view.residuals_mm) - 1, 1)
        marks = tuple((i, str(i)) for i in sorted({0, last // 2, last}))
        pose = min(self._slider.value or 0, last)
        self._slider.show(residuals_svg(view), (0, last), pose, marks)
        self._all.visible = bool(view.excluded)
        self._show_pose()

    def _rows(self) -> range:
        """Return the poses that are chosen."""
        first = self._slider.value
        if self._view is None or first is None:
            return range(0)
        return range(first, min(first + int(self._count.value), len(self._view.residuals_mm)))

    def _show_pose(self) -> None:
        rows, view = self._rows(), self._view
        if view is None or not len(rows):
            return
        mark, residual_mm = int(view.marks[rows[0]]), float(view.residuals_mm[rows[0]])
        self._pose.content = style.text(
            f"Pose {rows[0]}: {residual_mm:.2f} mm from the common tip, {MARKS[mark]}."
        )
        which = f"pose {rows[0]}" if len(rows) == 1 else f"poses {rows[0]} to {rows[-1]}"
        again = set(rows) <= set(view.excluded)
        self._toggle.label = f"Include {which}" if again else f"Exclude {which}"

    def _change(self, event: Any) -> None:
        view = self._view
        rows, before = set(self._rows()), set(() if view is None else view.excluded)
        wanted = before - rows if rows <= before else before | rows
        self._context.send(lambda: ExcludePoses(self._step, tuple(sorted(wanted))), event)


def coverage(view: CalibrationView) -> str:
    """Return the picture of the motion and what to do next in words."""
    swing = view.swing
    if swing is None:
        return ""
    gap = f"Widest direction gap: {swing.gap_deg:.0f}°. "
    after = ""
    if swing.next_sigma_mm is not None:
        after = f" (expected tip error {swing.next_sigma_mm:.3f} mm)"
    if swing.next_tilt_deg is None:
        advice = f"No next pose: {swing.next_words}."
    else:
        advice = f"Next best pose: {swing.next_words}{after}."
    return style.text("Shaft directions by tilt") + coverage_svg(swing) + style.note(gap + advice)


def _residuals_title(view: CalibrationView) -> str:
    n = len(view.residuals_mm)
    text = (
        f"Height: up to {residual_top_mm(view):.2f} mm; dashed: RMSE {view.rmse_mm:.2f} mm "
        f"of {view.n_used} of {n} used. Small residuals alone do not prove a good "
        "calibration. Click a pose to select it."
    )
    entries = (
        (css(BLUE), "●", USED),
        (css(VERMILLION), "×", REJECTED),
        (GREY, "○", EXCLUDED),
    )
    spans = "".join(
        f'<span><b style="color:{color}">{symbol}</b> {MARKS[mark]} '
        f"({int((view.marks == mark).sum())})</span>"
        for color, symbol, mark in entries
    )
    return style.text(text) + f'<div class="r-key">{spans}</div>'
