"""Place by hand: sliders that lay the bed on the bone; the verdict follows when they rest."""

from typing import Any

import numpy as np

from rona_core.app.steps.implant.implant_bed import ImplantBed
from rona_core.app.steps.implant.messages import PlaceBed
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
from rona_ui.presentation.snapshot import Snapshot, changed

EXPLANATION = "Moves, turns and tilts the bed. The verdict follows when a slider rests."
REACH_MM = 60.0  # no region is larger; once there are maps, they say
ASKED = ("implant", "limit_mm", "probability", "burr_mm")  # of the fields above


class ByHandFolder:
    """Sliders of a placement, filled by the last one; ``asked`` holds the fields of the step."""

    def __init__(self, gui: Any, context: PanelContext, asked: Form) -> None:
        self._context, self._asked = context, asked
        self._sent: dict[str, Any] = {}
        self._form = form = Form(gui)
        self._window = gui.add_folder("Place by hand", visible=False, expand_by_default=False)
        with self._window:
            gui.add_html(style.text(EXPLANATION))
            self._across = {
                name: form.slider(name, label, 0.0, -REACH_MM, REACH_MM, 0.5)
                for name, label in (("u_mm", "Along u (mm)"), ("v_mm", "Along v (mm)"))
            }
            sliders = (
                *self._across.values(),
                form.slider("angle_deg", "Angle (deg)", 0.0, -180.0, 180.0, 1.0),
                form.slider("tilt_x_deg", "Tilt about x (deg)", 0.0, -15.0, 15.0, 0.5),
                form.slider("tilt_y_deg", "Tilt about y (deg)", 0.0, -15.0, 15.0, 0.5),
                form.slider("lift_mm", "Lift by hand (mm)", 0.0, 0.0, 4.0, 0.25),
            )
        for slider in sliders:
            on_change(slider, lambda e: context.send_debounced("bed", self.message, e))

    def message(self) -> PlaceBed:
        """Return the placement that the sliders hold, of what the fields of the step ask for."""
        self._sent = self._asked.values(*ASKED) | self._form.values()
        return PlaceBed(**self._sent)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the maps and the bed; a slider that is ahead of its own message is left alone."""
        self._window.visible = new.step("implant").blocked is None
        if old is None or old.busy != new.busy:
            self._form.enable(not new.busy)
        maps = new.session.results.maps
        if maps is not None and changed(old, new, "session.results.maps"):
            outer = maps.value.outer
            for name, slider in self._across.items():
                cells = outer.u_mm if name == "u_mm" else outer.v_mm
                slider.min, slider.max = float(np.floor(cells[0])), float(np.ceil(cells[-1]))
                slider.value = min(max(slider.value, slider.min), slider.max)
        held = new.session.results.get("bed")
        before = None if old is None else old.session.results.get("bed")
        if held is None or held is before or dict(held.arguments) == self._sent:
            return
        self._form.show(_slider_values(held.value))


def _slider_values(bed: ImplantBed) -> dict[str, float]:
    """Return where the sliders stand for a bed."""
    if bed.placed is None:
        return {}
    at = bed.placed.placement
    turns = np.rad2deg((at.angle_rad, at.tilt_x_rad, at.tilt_y_rad))
    angle, tilt_x, tilt_y = (round(float(turn), 2) for turn in turns)
    angle = (angle + 180.0) % 360.0 - 180.0
    return {
        "u_mm": float(at.u_mm),
        "v_mm": float(at.v_mm),
        "angle_deg": angle,
        "tilt_x_deg": tilt_x,
        "tilt_y_deg": tilt_y,
        "lift_mm": bed.lift_mm,
    }
