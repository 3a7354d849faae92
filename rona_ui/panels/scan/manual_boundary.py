"""Manual correction of a boundary in the shown A-scan."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.boundaries.ascan_view import AScanPlot, ScanName
from rona_core.app.steps.boundaries.messages import ClearBoundaryCorrections, CorrectBoundary
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change, on_click
from rona_ui.presentation.snapshot import Snapshot

BOUNDARIES = {"Inner boundary": "inner", "Outer boundary": "outer"}
EXPLANATION = (
    "Drag the black line to the echo, then set the boundary. The maps become stale: map "
    "again. Undo with Ctrl+Z."
)


class ManualBoundaryControls:
    """A closed folder: which boundary, where, and what to do."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self._plot: AScanPlot | None = None
        self._scan: ScanName = "first"
        self._hand_us: float | None = None
        self._window = gui.add_folder("Correct by hand", expand_by_default=False, visible=False)
        with self._window:
            gui.add_html(style.text(EXPLANATION))
            self._which = gui.add_dropdown("Boundary", tuple(BOUNDARIES))
            self._at = gui.add_slider("Time (µs)", 0.0, 60.0, 0.01, 0.0)
            self._set = gui.add_button("Set boundary", icon="check")
            self._other = gui.add_button("Use other echo", icon="switch-horizontal")
            self._remove = gui.add_button("Delete boundary", icon="x", color="gray")
            self._back = gui.add_button("Reset this A-scan", icon="arrow-back", color="gray")
            self._clear = gui.add_button("Reset all A-scans", icon="trash", color="gray")
            self._words = gui.add_html("")
        on_change(self._at, self._hold)
        on_change(self._which, lambda e: self._let_go())
        on_click(self._set, lambda e: self._send(self._place, e))
        on_click(self._other, lambda e: self._send(self._take_other, e))
        on_click(self._remove, lambda e: self._send(self._take_away, e))
        on_click(self._back, lambda e: self._send(self._as_detected, e))
        on_click(self._clear, lambda e: context.send(ClearBoundaryCorrections, e))

    @property
    def _boundary(self) -> str:
        return BOUNDARIES[self._which.value]

    def _hold(self, event: Any) -> None:
        plot, at_us = self._plot, float(self._at.value)
        if plot is not None:
            self._context.change_view(
                lambda v: replace(v, dragged_boundary=(plot.number, at_us), playing=False)
            )

    def _let_go(self) -> None:
        self._context.change_view(lambda v: replace(v, dragged_boundary=None))
        self._follow(None)

    def _send(self, make: Any, event: Any) -> None:
        plot, scan = self._plot, self._scan
        if plot is not None:
            message = make(plot, scan)
            self._context.send(lambda: message, event)
            self._context.change_view(lambda v: replace(v, dragged_boundary=None))

    def _place(self, plot: AScanPlot, scan: ScanName) -> CorrectBoundary:
        at_us = float(self._at.value)
        if self._boundary == "outer":
            return CorrectBoundary(plot.number, scan, outer_us=at_us)
        return CorrectBoundary(plot.number, scan, inner_us=at_us)

    @staticmethod
    def _take_other(plot: AScanPlot, scan: ScanName) -> CorrectBoundary:
        return CorrectBoundary(plot.number, scan, inner_us=plot.alternative_us)

    def _take_away(self, plot: AScanPlot, scan: ScanName) -> CorrectBoundary:
        remove = "outer" if self._boundary == "outer" else "inner"
        return CorrectBoundary(plot.number, scan, remove=remove)

    @staticmethod
    def _as_detected(plot: AScanPlot, scan: ScanName) -> ClearBoundaryCorrections:
        return ClearBoundaryCorrections(scan, plot.number)

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
        words = "" if not count else f"{count} corrected by hand in total."
        self._words.content = style.text(words) if words else ""
        self._follow(new.view.dragged_boundary)

    def _follow(self, hand: tuple[int, float] | None) -> None:
        """Put the slider where the boundary is, unless somebody holds it."""
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
