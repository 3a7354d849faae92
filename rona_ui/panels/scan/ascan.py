"""A-scan panel: B-scan image, which is also the slider, and the graph of one A-scan."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.boundaries.ascan_view import (
    AScanPlot,
    ScanName,
    ascan_plot,
    scan_number_at,
)
from rona_core.app.steps.boundaries.handlers import capture_of
from rona_ui.panels.scan.ascan_graph import BANDS, HIGH, KEY, LOW, SERIES, ascan_data
from rona_ui.panels.scan.bscan_slider import ScanSlider
from rona_ui.panels.scan.manual_boundary import ManualBoundaryControls
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.graph_style import PADDING, axis
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState

SCANS: dict[str, ScanName] = {
    "First pass": "first",
    "Second pass": "second",
    "Handheld scan": "hand",
}
BARS = "Bars at the bottom: search gates of the boundaries. Drag to zoom."
NOTHING = "A-scans appear with a scan (step 8) or a handheld scan (step 9)."


def shown_scans(snapshot: Snapshot) -> tuple[str, ...]:
    """Return the words for the scans that there are, and for the one that is looked at."""
    session = snapshot.session
    return tuple(
        words
        for words, scan in SCANS.items()
        if scan == snapshot.scan or capture_of(session, scan) is not None
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
        self._gui = gui
        self._pass = gui.add_dropdown("A-scans of", tuple(SCANS), visible=False)
        self._words = gui.add_html(style.text(NOTHING))
        self._slider = ScanSlider(gui, context)
        self._folder = gui.add_folder(None)
        self._key = gui.add_html(style.key(KEY) + style.text(BARS), visible=False)
        self._hand = ManualBoundaryControls(gui, context)
        self._plot: Any = None
        self._extent: tuple[float, float] = (0.0, 0.0)
        on_change(
            self._pass,
            lambda e: context.change_view(lambda v: with_scan(v, SCANS[self._pass.value])),
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow cursor, scan, detection and what is set by hand."""
        if old is not None and _key(old) == _key(new) and old.live.ascan is new.live.ascan:
            return
        self._offer(new)
        number = shown_number(new)
        live = new.live.ascan if new.scanning else None
        plot = ascan_plot(new.session, number, live, new.scan)
        self._slider.render(None if live is not None else number, new)
        self._hand.render(None if live is not None else plot, new)
        self._key.visible = plot is not None
        if plot is None:
            if self._plot is not None:
                self._plot.remove()
                self._plot = None
            self._words.content = style.text(NOTHING)
            return
        self._draw(plot, new)
        self._words.content = style.note(plot.remark, "" if plot.fine else "warn")

    def _offer(self, new: Snapshot) -> None:
        """Let the scans that there are be chosen."""
        offered = shown_scans(new)
        if tuple(self._pass.options) != offered:
            self._pass.options = offered
        self._pass.value = next(words for words, scan in SCANS.items() if scan == new.scan)
        self._pass.visible = len(offered) > 1

    def _draw(self, plot: AScanPlot, new: Snapshot) -> None:
        hand = new.view.dragged_boundary
        hand_us = hand[1] if hand is not None and hand[0] == plot.number else None
        data = ascan_data(plot, hand_us)
        end_us = float(plot.time_us[-1]) if plot.end_us is None else plot.end_us
        extent = (float(plot.time_us[0]), end_us)
        if self._plot is not None and extent == self._extent:
            self._plot.data = data
            return
        if self._plot is not None:
            self._plot.remove()
        self._extent = extent
        with self._folder:
            self._plot = self._gui.add_uplot(
                data,
                SERIES,
                bands=BANDS,
                scales={"x": {"time": False, "range": extent}, "y": {"range": (LOW, HIGH)}},
                axes=(axis("time (µs)"), axis("normalised amplitude")),
                legend={"show": False},
                cursor={"drag": {"x": True, "y": False}},
                height=210,
                padding=PADDING,
            )


def _key(snapshot: Snapshot) -> tuple[object, ...]:
    """Return what the drawing depends on, apart from the live A-scan."""
    session, view = snapshot.session, snapshot.view
    return (
        id(session.captures.scan), id(session.captures.second), id(session.captures.sono_scan),
        id(session.results.roll), id(session.results.tool), id(session.results.sono_detection),
        id(session.results.second), id(session.results.detection),
        id(session.results.second_detection), id(session.boundary_edits),
        snapshot.scan_cursor, snapshot.scan, view.dragged_boundary, snapshot.busy,
    )  # fmt: skip
