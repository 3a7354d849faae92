"""Manual correction of a boundary in the shown A-scan."""

from typing import Any, Literal

from rona_core.app.steps.boundaries.ascan_view import AScanPlot, ScanName
from rona_core.app.steps.boundaries.messages import ClearBoundaryCorrections, CorrectBoundary
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change, on_click
from rona_ui.presentation.snapshot import Snapshot

BOUNDARIES: dict[str, Literal["inner", "outer"]] = {
    "Inner boundary": "inner",
    "Outer boundary": "outer",
}
EXPLANATION = (
    "Drag the black line to the echo, then set the boundary. The maps become stale: map "
    "again. Undo with Ctrl+Z."
)


class ManualBoundaryControls:
    """A closed folder: which boundary, where, and what to do."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._gui, self._context = gui, context
        self._plot: AScanPlot | None = None
        self._scan: ScanName = "first"
        self._window = gui.add_folder("Correct by hand", expand_by_default=False, visible=False)
        with self._window:
            gui.add_html(style.text(EXPLANATION))
            self._which = gui.add_dropdown("Boundary", tuple(BOUNDARIES))
            self._at = gui.add_slider("Time (µs)", 0.0, 60.0, 0.01, 0.0)
            self._button("Set boundary", "check", self._place)
            self._other = self._button("Use other echo", "switch-horizontal", self._take_other)
            self._button("Delete boundary", "x", self._take_away, color="gray")
            self._back = self._button(
                "Reset this A-scan", "arrow-back", self._as_detected, color="gray"
            )
            self._clear = context.send_button(
                gui, "Reset all A-scans", "trash", ClearBoundaryCorrections
            )
            self._words = gui.add_html("")
        on_change(self._at, self._hold)
        on_change(self._which, lambda e: self._let_go())

    def _button(self, label: str, icon: str, make: Any, color: str | None = None) -> Any:
        """Add a button that sends ``make(plot)`` of the A-scan that is looked at."""
        button = self._gui.add_button(label, icon=icon, color=color)

        def send(event: Any) -> None:
            plot = self._plot
            if plot is not None:
                message = make(plot)
                self._context.send(lambda: message, event)
                self._context.set_view(dragged_boundary=None)

        on_click(button, send)
        return button

    @property
    def _boundary(self) -> Literal["inner", "outer"]:
        return BOUNDARIES[self._which.value]

    def _hold(self, event: Any) -> None:
        if self._plot is not None:
            held = (self._plot.number, float(self._at.value))
            self._context.set_view(dragged_boundary=held, playing=False)

    def _let_go(self) -> None:
        self._context.set_view(dragged_boundary=None)
        self._follow(None)

    def _place(self, plot: AScanPlot) -> CorrectBoundary:
        place: dict[str, Any] = {f"{self._boundary}_us": float(self._at.value)}
        return CorrectBoundary(plot.number, self._scan, **place)

    def _take_other(self, plot: AScanPlot) -> CorrectBoundary:
        return CorrectBoundary(plot.number, self._scan, inner_us=plot.alternative_us)

    def _take_away(self, plot: AScanPlot) -> CorrectBoundary:
        return CorrectBoundary(plot.number, self._scan, remove=self._boundary)

    def _as_detected(self, plot: AScanPlot) -> ClearBoundaryCorrections:
        return ClearBoundaryCorrections(self._scan, plot.number)

    def render(self, plot: AScanPlot | None, new: Snapshot) -> None:
        """Follow the A-scan that is looked at; without boundaries there is nothing to correct."""
        judged = plot is not None and plot.front_gate_us is not None and not new.busy
        self._plot, self._scan = plot, new.scan
        self._window.visible = judged
        if plot is None or not judged:
            return
        end_us = float(plot.end_us or plot.time_us[-1])
        self._at.min, self._at.max = round(float(plot.time_us[0]), 2), round(end_us, 2)
        self._other.visible = plot.alternative_us is not None
        self._back.visible = plot.by_hand
        count = len(new.session.boundary_edits)
        self._clear.visible = count > 0
        self._words.content = style.text(f"{count} corrected by hand in total.") if count else ""
        self._follow(new.view.dragged_boundary)

    def _follow(self, hand: tuple[int, float] | None) -> None:
        """Put the slider where the boundary is, unless it is being dragged."""
        plot = self._plot
        if plot is None or (hand is not None and hand[0] == plot.number):
            return
        found = plot.outer_us
        if self._boundary == "inner":
            found = next(
                (t for t in (plot.inner_us, plot.guess_us, plot.outer_us) if t is not None), None
            )
        if found is not None:
            self._at.value = round(found, 2)
