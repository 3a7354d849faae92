"""Step 5: a raster or spiral by rule instead of a demonstration."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.path.messages import GenerateScanPattern
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import Drawing, ViewState

KINDS = {"Raster": "raster", "Spiral": "spiral"}
HELP = {
    "center": "Click the skull to set the centre of the pattern.",
    "boundary": "Click the corners of the boundary one after the other, or drag along it.",
}


class PatternControls:
    """What the pattern is like, where its middle and its boundary are, and a button to make it."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context, self._view = context, ViewState()
        with gui.add_folder("Pattern", expand_by_default=False):
            gui.add_html(
                style.text(
                    "Generates lines on the measured surface (step 4), in the region or "
                    "within a boundary you draw."
                )
            )
            form = self._form = Form(gui)
            form.choice("kind", "Pattern", KINDS, "raster")
            form.number("spacing_mm", "Spacing (mm)", 4.0, 0.5, 20.0, 0.5)
            form.number("turn_deg", "Direction (deg)", 0.0, -180.0, 180.0, 5.0)
            form.number("margin_mm", "Margin (mm)", 0.0, 0.0, 40.0, 0.5, "From the boundary")
            form.number("radius_mm", "Radius (mm)", 0.0, 0.0, 45.0, 1.0, "0: radius of the region")
            self._center = gui.add_button("Pick centre", icon="target", color="gray")
            self._boundary = gui.add_button("Draw boundary", icon="polygon", color="gray")
            self._help = gui.add_html("")
            self._done = gui.add_button("Done", icon="check", visible=False)
            self._drop = gui.add_button(
                "Clear centre and boundary", icon="x", color="gray", visible=False
            )
            self._make = gui.add_button("Generate pattern", icon="route")
        on_click(self._center, lambda e: self._mode("center"))
        on_click(self._boundary, lambda e: self._mode("boundary"))
        on_click(self._done, lambda e: self._mode(None))
        on_click(self._drop, lambda e: context.change_view(_without))
        on_click(self._make, lambda e: context.send(self.message, e))

    def _mode(self, mode: Drawing | None) -> None:
        self._context.change_view(lambda v: replace(v, drawing=mode, picks=()))

    def message(self) -> Any:
        """Return the pattern with these parameters."""
        values = self._form.values()
        values["radius_mm"] = values["radius_mm"] or None
        return GenerateScanPattern(
            **values, center_base_mm=self._view.center, boundary_base_mm=self._view.boundary
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
        if self._help.content != words:
            self._help.content = words
        self._done.visible = drawing
        self._drop.visible = not drawing and bool(view.center or view.boundary)
        self._make.visible = not drawing
        self._make.disabled = blocked or 0 < len(view.boundary) < 3
        self._form.enable(not new.busy)


def _without(view: ViewState) -> ViewState:
    return replace(view, center=None, boundary=())
