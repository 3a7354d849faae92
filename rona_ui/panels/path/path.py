"""Step 5: the pointer demonstrates the scan path, or a raster or spiral is made by rule."""

from typing import Any

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.steps.implant.view import asked_implant
from rona_core.app.steps.path.messages import (
    ClearPaintedRegions,
    GenerateScanPattern,
    PaintRegion,
    StartPathCapture,
    TakePathPoints,
)
from rona_core.app.steps.path.path_checks import expected_coverage
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.capture_controls import DrawingControls, ImportControls, Lifts, Picks
from rona_ui.panels.widgets.form import Form, PanelContext
from rona_ui.panels.widgets.step_panel import LoadFolder, StepPanel
from rona_ui.presentation.colors import BLUE, GREEN, INK, ORANGE, PURPLE, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import PAINTING, Drawing, ViewState
from rona_ui.viewer.bindings import Event

COVERAGE = FIGURES["coverage_predicted_fraction"]

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


MADE = {GenerateScanPattern.__name__: "Pattern", TakePathPoints.__name__: "Imported path"}
HELP = {
    "center": "Click the skull to set the centre of the pattern.",
    "boundary": "Click the corners of the boundary one after the other, or drag along it.",
}


class PathPanel(StepPanel):
    """A meander by the operator, a line drawn by mouse, or a pattern."""

    step = "path"
    activity = "StartPathCapture"
    explanation = (
        "The pointer demonstrates the scan path: a raster over the region, or a line you "
        "draw on the skull. Or generate a pattern on the measured surface."
    )
    start = "Record raster path"

    def build(self) -> None:
        """Add duration, spacing, drawing."""
        self.form.of(StartPathCapture, "duration_s", "spacing_mm")
        self._drawing = DrawingControls(self.gui, self.context, "path", self._line)
        self._key = self.gui.add_html("")
        self._painting = PaintingControls(self.gui, self.context)
        self._pattern = PatternControls(self.gui, self.context)
        self._import = ImportControls(self.gui, self.context, "path")
        self._load = LoadFolder(self.gui, self.context, "path")

    def _line(self, picks: Picks, _lifts: Lifts) -> Any:
        duration_s = max(5.0, 0.5 * len(picks))
        return StartPathCapture(duration_s=duration_s, picks_base_mm=picks)

    def message(self) -> Any:
        """Return the meander."""
        return StartPathCapture(**self.form.values())

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow drawing."""
        self._drawing.render(new, _drawn_words(new))
        self._key.content = style.key(scene_key(new))
        self._painting.render(new)
        self._pattern.render(new)
        self._import.render(new)
        self._load.render(new)

    def remarks(self, snapshot: Snapshot) -> str:
        """Say how many points were demonstrated."""
        derived = snapshot.session.results.path
        if derived is None:
            return ""
        made = MADE.get(derived.message, "Demonstrated path")
        count = len(derived.value.points_base)
        words = f"{made} of {count} points."
        share = expected_coverage(snapshot.session)
        if share is not None:
            words += f" {COVERAGE.named(share)} of the region."
        return style.note(words, "good")


def scene_key(snapshot: Snapshot) -> tuple[tuple[str, str], ...]:
    """Return colour and word of what the scene shows in this step."""
    session = snapshot.session
    key = [(css(PURPLE), "region")]
    if session.results.surface is not None:
        key += [(css(BLUE), "measured surface")]
        key += [(css(INK), f"outline of {asked_implant(session)}")]
    if session.results.path is not None:
        key += [(css(ORANGE), "path")]
    return tuple(key)


def _drawn_words(snapshot: Snapshot) -> str:
    """Return how much of the region the path that is being drawn would cover; empty before one."""
    picks = snapshot.view.picks
    share = expected_coverage(snapshot.session, picks) if len(picks) > 1 else None
    return "" if share is None else f"{COVERAGE.named(share)} of the region."


class PatternControls:
    """What the pattern is like, where its middle and its boundary are, and a button to make it."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._view = ViewState()
        with gui.add_folder("Pattern", expand_by_default=False):
            gui.add_html(
                style.text(
                    "Generates lines on the measured surface (step 4), in the region or "
                    "within a boundary you draw."
                )
            )
            form = self._form = Form(gui)
            form.of(GenerateScanPattern, "kind", "spacing_mm", "turn_deg", "margin_mm", "radius_mm")
            self._center = context.view_button(
                gui, "Pick centre", "target", drawing="center", picks=()
            )
            self._boundary = context.view_button(
                gui, "Draw boundary", "polygon", drawing="boundary", picks=()
            )
            self._help = gui.add_html("")
            self._done = context.view_button(
                gui, "Done", "check", color=None, drawing=None, picks=()
            )
            self._drop = context.view_button(
                gui, "Clear centre and boundary", "x", center=None, boundary=()
            )
            self._make = context.send_button(
                gui, "Generate pattern", "route", self.message, color=None
            )

    def message(self) -> Any:
        """Return the pattern with these parameters."""
        return GenerateScanPattern(
            **self._form.values(),
            center_base_mm=self._view.center,
            boundary_base_mm=self._view.boundary,
        )

    def render(self, new: Snapshot) -> None:
        """Show what can be done now."""
        view = self._view = new.view
        blocked = new.busy or new.session.results.surface is None
        drawing = view.drawing in HELP
        for button in (self._center, self._boundary):
            button.disabled = blocked
            button.visible = not drawing
        words = style.note(HELP[view.drawing]) if view.drawing in HELP else ""
        if not drawing and (view.center or view.boundary):
            held = ["centre"] if view.center else []
            held += [f"boundary of {len(view.boundary)} corners"] if view.boundary else []
            words = style.note(f"Set: {' and '.join(held)}.")
        elif not drawing and new.session.results.surface is None:
            words = style.note("Measure the surface first (step 4).")
        self._help.content = words
        self._done.visible = drawing
        self._drop.visible = not drawing and bool(view.center or view.boundary)
        self._make.visible = not drawing
        self._make.disabled = blocked or 0 < len(view.boundary) < 3
        self._form.enable(not new.busy)
