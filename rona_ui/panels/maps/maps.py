"""Step 9: both boundaries are detected, mapped and fused with the pointer cloud."""

from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.steps.maps.map_accuracy import accuracy_words
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.maps.view import MapLayers, layers_of
from rona_ui.panels.acoustics import SpeedFields
from rona_ui.panels.handheld import SonoControls
from rona_ui.panels.maps.second_pass import SecondFolder
from rona_ui.panels.setup.probe import advice_note
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import Door, follow
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.scene.colors import viridis_css
from rona_ui.scene.maps.map_choice import chosen_accuracy, chosen_key, chosen_maps, shows_hand
from rona_ui.scene.maps.maps import sigma_of
from rona_ui.view_state import Picture

METHODS = {
    "Front echo subtracted": "subtract",
    "Matched filter (as the paper)": "matched",
    "Threshold (as the paper)": "threshold",
}
SPEEDS = {"Calibrated, else published": "known", "As given below": "given"}
QUANTITIES = {
    "Bone thickness": "thickness",
    "Height over the map's plane": "height",
    "Expected error of the boundary": "sigma",
}
TITLES = {"thickness": "Bone thickness", "height": "Height", "sigma": "Expected error, 1 σ"}
SHOWN = {
    "Inner boundary": ("inner",),
    "Outer boundary": ("outer",),
    "Outer, fused with pointer": ("fused",),
    "Outer and inner": ("outer", "inner"),
}
MAP_NAMES = frozenset(("outer", "inner", "fused"))


class MapsPanel(StepPanel):
    """Detection, cell size, sound speed; which map is shown in which colours."""

    step = "maps"
    explanation = (
        "Two echoes in every A-scan give the outer and the inner boundary of the bone. "
        "Places that cannot be trusted are left out, never guessed."
    )
    start = "Map the boundaries"

    def __init__(self, gui: Any, door: Door) -> None:
        super().__init__(gui, door)
        with self.folder:
            self._second = SecondFolder(gui, door, self.message)
            self._sono = SonoControls(gui, door)

    def build(self) -> None:
        """Add the parameters and the choice of what is shown."""
        self.form.choice("method", "Detection", METHODS, "subtract")
        self.form.choice("speed", "Bone speed", SPEEDS, "known")
        self._given = self.gui.add_number("Bone (mm/µs)", 2.65, min=1.5, max=4.5, step=0.01)
        self.form.number("cell_mm", "Cell (mm)", 1.0, 0.5, 5.0, 0.5)
        with self.gui.add_folder("Speed of sound", expand_by_default=False):
            self._speed = SpeedFields(self.gui, self.door)
        self._shown = self.gui.add_dropdown("Show", tuple(SHOWN))
        self._quantity = self.gui.add_dropdown("Colours", tuple(QUANTITIES))
        self._cut = self.gui.add_checkbox(
            "Open the skull", True, hint="Takes the drawn bone away over the region"
        )
        self._bar = self.gui.add_html("")
        self.form.on_change(self._changed)
        follow(self._shown, lambda e: self._show(SHOWN[self._shown.value]))
        follow(
            self._quantity,
            lambda e: self.door.view(lambda v: replace(v, quantity=self._chosen())),
        )
        follow(self._cut, lambda e: self.door.view(lambda v: replace(v, cut=self._cut.value)))

    def _changed(self, name: str, event: Any) -> None:
        if name == "speed":
            self._given.visible = self.form.values("speed")["speed"] == "given"

    def _chosen(self) -> Any:
        return QUANTITIES[self._quantity.value]

    def _show(self, names: tuple[str, ...]) -> None:
        hide = MAP_NAMES - set(names)
        self.door.view(lambda v: replace(v, hidden=(v.hidden - set(names)) | hide))

    def message(self) -> Any:
        """Return the mapping with these parameters."""
        values = self.form.values()
        given = float(self._given.value) if values.pop("speed") == "given" else None
        return StartMapping(**values, sound_speed_mm_per_us=given)

    def update(self, old: Picture | None, new: Picture) -> None:
        """Draw the colour bar once there are maps."""
        maps = chosen_maps(new)
        self._given.visible = self.form.values("speed")["speed"] == "given"
        self._given.disabled = new.busy
        if old is None or old.session is not new.session or old.busy != new.busy:
            self._speed.show(new.session, new.busy)
        self._sono.render(new)
        for field in (self._shown, self._quantity, self._cut):
            field.visible = maps is not None
        if (
            old is None
            or chosen_key(old) != chosen_key(new)
            or old.view.quantity != new.view.quantity
        ):
            self._bar.content = (
                "" if maps is None else color_bar(layers_of(maps, new.view.quantity, sigma_of(new)))
            )
        self._second.render(old, new)

    def remarks(self, picture: Picture) -> str:
        """Say how much of the inner boundary was found."""
        results, maps = picture.session.results, chosen_maps(picture)
        found = results.sono_detection if shows_hand(picture) else results.detection
        if found is None or maps is None:
            return ""
        value = found.value
        words = (
            f"Outer boundary in {100.0 * float(value.outer_ok.mean()):.0f} %, inner boundary in "
            f"{100.0 * float(value.inner_ok.mean()):.0f} % of {len(value.inner_ok)} A-scans."
        )
        accuracy = chosen_accuracy(picture)
        if accuracy is not None:
            words += f" {accuracy_words(maps, accuracy)}"
        return style.note(words, "good") + advice_note(picture.session, only_another=True)


def color_bar(layers: MapLayers) -> str:
    """Return the colour bar with its limits in mm."""
    title, places = TITLES[layers.quantity], 2 if layers.quantity == "sigma" else 1
    low, high = layers.low_mm, layers.high_mm
    values = np.concatenate([layers.part(name).values_mm for name in sorted(MAP_NAMES)])
    below, above = ("≤ " if (values < low).any() else ""), ("≥ " if (values > high).any() else "")
    middle = 0.5 * (low + high)
    ticks = f"<span>{below}{low:.{places}f}</span><span>{middle:.{places}f}</span>"
    return (
        f'<div class="r-text" style="padding-bottom:2px">{title} (mm)</div>'
        f'<div class="r-bar" style="background:{viridis_css()}"></div>'
        f'<div class="r-ticks">{ticks}<span>{above}{high:.{places}f}</span></div>'
    )
