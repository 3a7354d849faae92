"""Place by hand: sliders that lay the bed on the bone; the verdict follows when they rest."""

from typing import Any

import numpy as np

from rona_core.app.steps.implant.implant_bed import ImplantBed
from rona_core.app.steps.implant.messages import PlaceBed
from rona_core.app.steps.implant.view import placed_turns
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.presentation.snapshot import Snapshot, changed

EXPLANATION = "Moves, turns and tilts the bed. The verdict follows when a slider rests."
HELP = "Click the skull, or drag on it: the bed follows, and its verdict. Drag beside it to rotate."
ASKED = ("implant", "limit_mm", "probability", "burr_mm")  # of the fields above


class ByHandFolder:
    """Sliders of a placement, filled by the last one; ``asked`` holds the fields of the step."""

    def __init__(self, gui: Any, context: PanelContext, asked: Form) -> None:
        self._context, self._asked = context, asked
        self._sent: dict[str, Any] = {}
        self._form = form = Form(gui, lambda _, e: context.send_debounced("bed", self.message, e))
        self._window = gui.add_folder("Place by hand", visible=False, expand_by_default=False)
        with self._window:
            gui.add_html(style.text(EXPLANATION))
            hint = "Moves the bed to where you click or drag on the skull"
            self._move = gui.add_button("Move on the skull", icon="target", color="gray", hint=hint)
            self._help = gui.add_html("")
            self._done = context.view_button(gui, "Done", "check", drawing=None, move_target=None)
            self._across = {
                name: form.slider(PlaceBed, name, **{name: 0.0}) for name in ("u_mm", "v_mm")
            }
            for name in ("angle_deg", "tilt_x_deg", "tilt_y_deg", "lift_mm"):
                form.slider(PlaceBed, name)
        on_click(self._move, self._begin)

    def _begin(self, event: Any) -> None:
        self._context.set_view(drawing="implant", move_target=None)
        self._context.set_camera("Region")

    def message(self) -> PlaceBed:
        """Return the placement that the sliders hold, of what the fields of the step ask for."""
        self._sent = self._asked.values(*ASKED) | self._form.values()
        return PlaceBed(**self._sent)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the maps and the bed; a slider that is ahead of its own message is left alone."""
        self._window.visible = new.step("implant").blocked is None
        if old is None or old.busy != new.busy:
            self._form.enable(not new.busy)
        held, moving = new.session.results.get("bed"), new.view.drawing == "implant"
        self._move.visible, self._done.visible = not moving, moving
        self._move.disabled = new.busy or held is None
        self._help.content = style.note(HELP) if moving else ""
        maps = new.session.results.maps
        if maps is not None and changed(old, new, "session.results.maps"):
            outer = maps.value.outer
            for name, slider in self._across.items():
                cells = outer.u_mm if name == "u_mm" else outer.v_mm
                slider.min, slider.max = float(np.floor(cells[0])), float(np.ceil(cells[-1]))
                slider.value = min(max(slider.value, slider.min), slider.max)
        before = None if old is None else old.session.results.get("bed")
        if held is None or held is before or dict(held.arguments) == self._sent:
            return
        self._form.show(_slider_values(held.value))


def _slider_values(bed: ImplantBed) -> dict[str, float]:
    """Return where the sliders stand for a bed."""
    if bed.placed is None:
        return {}
    at = bed.placed.placement
    return {"u_mm": float(at.u_mm), "v_mm": float(at.v_mm), **placed_turns(bed)}
