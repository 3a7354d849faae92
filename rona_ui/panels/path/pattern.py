"""Step 5: a raster or spiral by rule instead of a demonstration."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.path.messages import GenerateScanPattern
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import Door, listen
from rona_ui.view_state import Drawing, Picture, ViewState

KINDS = {"Raster": "raster", "Spiral": "spiral"}
HELP = {
    "center": "Click the skull where the middle of the pattern shall be.",
    "boundary": "Click the corners of the boundary in turn, or drag along it.",
}


class PatternControls:
    """What the pattern is like, where its middle and its boundary are, and a button to make it."""

    def __init__(self, gui: Any, door: Door) -> None:
        self._door, self._view = door, ViewState()
        with gui.add_folder("Pattern", expand_by_default=False):
            gui.add_html(
                style.text(
                    "Lines by rule on the measured surface (step 4), in the region or within a "
                    "boundary that you draw."
                )
            )
            form = self._form = Form(gui)
            form.choice("kind", "Pattern", KINDS, "raster")
            form.number("spacing_mm", "Spacing (mm)", 4.0, 0.5, 20.0, 0.5)
            form.number("turn_deg", "Direction (deg)", 0.0, -180.0, 180.0, 5.0)
            form.number("margin_mm", "Margin (mm)", 0.0, 0.0, 40.0, 0.5, "From the boundary")
            form.number("radius_mm", "Radius (mm)", 0.0, 0.0, 45.0, 1.0, "0: that of the region")
            self._center = gui.add_button("Click the centre", icon="target", color="gray")
            self._boundary = gui.add_button("Draw the boundary", icon="polygon", color="gray")
            self._help = gui.add_html("")
            self._done = gui.add_button("Done", icon="check", visible=False)
            self._drop = gui.add_button(
                "Forget centre and boundary", icon="x", color="gray", visible=False
            )
            self._make = gui.add_button("Make the pattern", icon="route")
        listen(self._center, lambda e: self._mode("center"))
        listen(self._boundary, lambda e: self._mode("boundary"))
        listen(self._done, lambda e: self._mode(None))
        listen(self._drop, lambda e: door.view(_without))
        listen(self._make, lambda e: door.send(self.message, e))

    def _mode(self, mode: Drawing | None) -> None:
        self._door.view(lambda v: replace(v, drawing=mode, picks=()))

    def message(self) -> Any:
        """Return the pattern with these parameters."""
        values = self._form.values()
        values["radius_mm"] = values["radius_mm"] or None
        return GenerateScanPattern(
            **values, center_base_mm=self._view.center, boundary_base_mm=self._view.boundary
        )

    def render(self, new: Picture) -> None:
        """Show what can be done now."""
        view = self._view = new.view
        blocked = new.busy or new.session.results.surface is None
        drawing = view.drawing in HELP
        for button in (self._center, self._boundary):
            button.disabled = blocked
            button.visible = not drawing
        words = style.note(HELP[view.drawing]) if view.drawing in HELP else ""
        if not drawing and (view.center or view.boundary):
            held = ["a centre"] if view.center else []
            held += [f"a boundary of {len(view.boundary)} corners"] if view.boundary else []
            words = style.note(f"There is {' and '.join(held)}.")
        elif not drawing and new.session.results.surface is None:
            words = style.note("First sample the surface (step 4).")
        if self._help.content != words:
            self._help.content = words
        self._done.visible = drawing
        self._drop.visible = not drawing and bool(view.center or view.boundary)
        self._make.visible = not drawing
        self._make.disabled = blocked or 0 < len(view.boundary) < 3
        self._form.enable(not new.busy)


def _without(view: ViewState) -> ViewState:
    return replace(view, center=None, boundary=())
