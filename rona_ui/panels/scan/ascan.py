"""A-scan panel: B-scan image, which is also the slider, and the graph of one A-scan."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np

from rona_core.app.steps.boundaries.ascan_view import (
    AScanPlot,
    ScanName,
    ascan_plot,
    scan_number_at,
)
from rona_core.app.steps.boundaries.messages import ClearBoundaryCorrections, CorrectBoundary
from rona_core.app.steps.boundaries.step import scans_of
from rona_core.geometry.arrays import Floats
from rona_ui.panels.scan.bscan_slider import ScanSlider
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, on_change, on_click
from rona_ui.panels.widgets.graphs import Axis, Graph
from rona_ui.presentation.colors import CATEGORIES, GREEN, ORANGE, PURPLE, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.view_state import ViewState

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


SCANS: dict[str, ScanName] = {
    "First pass": "first",
    "Tilted passes": "second",
    "Handheld scan": "hand",
}
BARS = "Bars at the bottom: search gates of the boundaries. Drag to zoom."
NOTHING = "A-scans appear with a scan (step 8) or a handheld scan (step 9)."
FOLLOWED = (
    "session.captures.scan",
    "session.captures.second",
    "session.captures.sono_scan",
    "session.results",
    "session.boundary_edits",
    "scan_cursor",
    "scan",
    "view.dragged_boundary",
    "busy",
    "live.ascan",
)

LOW, HIGH = -1.05, 1.05
BELOW = -8.0  # out of sight: gaps of NaN would not be drawn as gaps
THIN_US = 0.004  # least half width of a line
GATE_TOP = -0.96
AMPLITUDE = Axis("normalised amplitude", LOW, HIGH)
Span = tuple[float, float]

SERIES: tuple[dict[str, Any], ...] = (
    {"label": "time"},
    {"label": "signal", "stroke": "#a9b3bd", "width": 1},
    {"label": "envelope", "stroke": "#52606d", "width": 1},
    {"label": "compressed", "stroke": css(CATEGORIES[0]), "width": 2},
    {"label": "without front", "stroke": css(PURPLE), "width": 2},
    {"label": "outer", "stroke": css(GREEN), "width": 1.5},
    {"label": "inner", "stroke": css(VERMILLION), "width": 1.5},
    {"label": "other echo", "stroke": css(ORANGE), "width": 2, "dash": (6, 4)},
    {"label": "does not count", "stroke": "#52606d", "width": 1.5, "dash": (2, 4)},
    {"label": "by hand", "stroke": "#1f2933", "width": 2},
    {"label": "gate of the front", "stroke": "transparent", "width": 0},
    {"label": "gate of the inner", "stroke": "transparent", "width": 0},
    {"label": "floor", "stroke": "transparent", "width": 0},
)
FLOOR = len(SERIES) - 1
BANDS = (
    {"series": (5, FLOOR), "fill": "rgba(0,158,115,0.30)"},
    {"series": (6, FLOOR), "fill": "rgba(213,94,0,0.30)"},
    {"series": (10, FLOOR), "fill": css(GREEN)},
    {"series": (11, FLOOR), "fill": css(VERMILLION)},
)
KEY = (
    ("#a9b3bd", "signal"),
    ("#52606d", "envelope"),
    (css(CATEGORIES[0]), "matched filter"),
    (css(PURPLE), "without front echo, enlarged"),
    (css(GREEN), "outer boundary ± σ"),
    (css(VERMILLION), "inner boundary ± σ"),
    (css(ORANGE), "other echo"),
)


def shown_scans(snapshot: Snapshot) -> tuple[str, ...]:
    """Return the words for the scans that there are, and for the one that is looked at."""
    session = snapshot.session
    return tuple(
        words
        for words, scan in SCANS.items()
        if scan == snapshot.scan or scans_of(session, scan) is not None
    )


def with_scan(view: ViewState, scan: ScanName) -> ViewState:
    """Return the view of another scan, from its beginning."""
    return replace(
        view,
        handheld=scan == "hand",
        second=scan == "second",
        cursor=None,
        handheld_cursor=0.0,
        playing=False,
        dragged_boundary=None,
    )


def shown_number(snapshot: Snapshot) -> int | None:
    """Return the number of the A-scan under the cursor; at the start without one."""
    return scan_number_at(snapshot.session, snapshot.scan_cursor or 0.0, snapshot.scan)


class AScanPanel:
    """Follows the cursor of the replay; while the robot scans, the newest A-scan."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._pass = gui.add_dropdown("A-scans of", tuple(SCANS), visible=False)
        self._words = gui.add_html(style.text(NOTHING))
        self._slider = ScanSlider(gui, context)
        self._graph = Graph(gui, 210)
        self._key = gui.add_html(style.key(KEY) + style.text(BARS), visible=False)
        self._hand = ManualBoundaryControls(gui, context)
        on_change(
            self._pass,
            lambda e: context.change_view(lambda v: with_scan(v, SCANS[self._pass.value])),
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow cursor, scan, detection and what is set by hand."""
        if not changed(old, new, *FOLLOWED):
            return
        self._offer(new)
        number = shown_number(new)
        live = new.live.ascan if new.scanning else None
        plot = ascan_plot(new.session, number, live, new.scan)
        self._slider.render(None if live is not None else number, new)
        self._hand.render(None if live is not None else plot, new)
        self._key.visible = plot is not None
        if plot is None:
            self._graph.clear()
            self._words.content = style.text(NOTHING)
            return
        hand = new.view.dragged_boundary
        hand_us = hand[1] if hand is not None and hand[0] == plot.number else None
        end_us = float(plot.time_us[-1]) if plot.end_us is None else plot.end_us
        time = Axis("time (µs)", float(plot.time_us[0]), end_us)
        self._graph.show(time, AMPLITUDE, ascan_data(plot, hand_us), SERIES, BANDS)
        self._words.content = style.note(plot.remark, "" if plot.fine else "warn")

    def _offer(self, new: Snapshot) -> None:
        """Let the scans that there are be chosen."""
        offered = shown_scans(new)
        if tuple(self._pass.options) != offered:
            self._pass.options = offered
        self._pass.value = next(words for words, scan in SCANS.items() if scan == new.scan)
        self._pass.visible = len(offered) > 1


def ascan_data(plot: AScanPlot, hand_us: float | None = None) -> tuple[Floats, ...]:
    """Return the columns of the graph, in the order of ``SERIES``.

    Boundaries are as wide as their sigma to both sides. The bars along the bottom are the gates.
    """
    boxes: list[tuple[Span | None, float]] = [
        (_around(plot.outer_us, plot.outer_sigma_us), 1.0),
        (_around(plot.inner_us, plot.inner_sigma_us), 1.0),
        (_around(plot.alternative_us, 0.0), 0.85),
        (_around(plot.guess_us, 0.0), 0.85),
        (_around(hand_us, 0.0), 1.0),
        (plot.front_gate_us, GATE_TOP),
        (plot.bone_gate_us, GATE_TOP),
    ]
    edges = [edge for span, _ in boxes if span is not None for edge in span]
    at = np.sort(np.concatenate((plot.time_us, np.repeat(np.array(edges, dtype=np.float64), 2))))
    curves = (plot.rf, plot.envelope, plot.compressed, plot.behind_front)
    return (
        at,
        *(np.interp(at, plot.time_us, curve) for curve in curves),
        *(box(at, span, top) for span, top in boxes),
        np.full(len(at), LOW - 0.1),
    )


def _around(place_us: float | None, sigma_us: float) -> Span | None:
    if place_us is None:
        return None
    half = max(sigma_us, THIN_US)
    return place_us - half, place_us + half


def box(at: Floats, span: Span | None, top: float) -> Floats:
    """Return a column that is ``top`` within a span, whose edges occur twice in ``at``."""
    column = np.full(len(at), BELOW)
    if span is not None:
        first = int(np.searchsorted(at, span[0], side="right")) - 1
        last = int(np.searchsorted(at, span[1], side="left"))
        column[first : last + 1] = top
    return column
