"""Painted regions of step 5: where to scan and what to avoid, by a brush on the skull."""

from typing import Any

from rona_core.app.steps.path.messages import ClearPaintedRegions, PaintRegion
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import PanelContext
from rona_ui.presentation.colors import GREEN, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import PAINTING, Drawing
from rona_ui.viewer.bindings import Event

WORDS: dict[Drawing, str] = {"paint_scan": "to scan", "paint_avoid": "to avoid"}
EXPLANATION = (
    "Patterns, recorded paths and further passes stay within the regions to scan and keep off "
    "the regions to avoid."
)
LEGEND = ((css(GREEN), "to scan"), (css(VERMILLION), "to avoid"))


class PaintingControls:
    """Buttons to paint either kind, the size of the brush, and how much is painted."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        with gui.add_folder("Paint regions", expand_by_default=False):
            gui.add_html(style.text(EXPLANATION))
            form = self._form = Form(gui, self._resize)
            form.of(PaintRegion, "radius_mm")
            self._paint = [
                context.view_button(gui, label, icon, drawing=kind, picks=(), stroke=())
                for label, icon, kind in (
                    ("Paint region to scan", "brush", "paint_scan"),
                    ("Paint region to avoid", "ban", "paint_avoid"),
                )
            ]
            self._words = gui.add_html("")
            self._done = context.view_button(
                gui, "Finish painting", "check", color=None, drawing=None, stroke=()
            )
            self._clear = context.send_button(
                gui, "Clear painted regions", "trash", ClearPaintedRegions
            )

    def _resize(self, name: str, event: Event) -> None:
        self._context.set_view(brush_mm=float(self._form.value(name)))

    def render(self, new: Snapshot) -> None:
        """Show what can be done now, and how much is painted."""
        painted, mode = new.session.painted, new.view.drawing
        measured = new.session.results.surface is not None
        for button in self._paint:
            button.visible, button.disabled = mode not in PAINTING, new.busy or not measured
        self._done.visible = mode in PAINTING
        self._clear.visible = mode not in PAINTING and len(painted) > 0
        self._clear.disabled = new.busy
        self._form.enable(not new.busy)
        counts = f"{len(painted.of('scan'))} to scan, {len(painted.of('avoid'))} to avoid"
        if mode in PAINTING:
            words = (
                f"Drag over the skull to paint a region {WORDS[mode]}, or click. Dragging beside "
                f"the skull rotates the view. Undo with Ctrl+Z. Strokes: {counts}."
            )
        elif not measured:
            words = "Measure the surface first (step 4)."
        else:
            words = f"Strokes: {counts}." if len(painted) else ""
        self._words.content = (style.note(words) if words else "") + (
            style.key(LEGEND) if len(painted) else ""
        )
