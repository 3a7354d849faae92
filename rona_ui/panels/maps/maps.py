"""Step 9: boundaries are detected, mapped and fused with the cloud; second pass over gaps."""

from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.steps.acoustics.view import loss_words
from rona_core.app.steps.boundaries.probe_advice import judge_bone
from rona_core.app.steps.maps.accuracy import accuracy_sentence, budgets
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.maps.view import (
    MapLayers,
    layers_of,
)
from rona_ui.panels.acoustics import SpeedFields
from rona_ui.panels.handheld import HandheldControls
from rona_ui.panels.maps.comparison import ComparisonFolder
from rona_ui.panels.maps.export import ExportFolder
from rona_ui.panels.maps.second_pass import SecondFolder
from rona_ui.panels.maps.volume import VolumeFolder
from rona_ui.panels.setup.probe import advice_note
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.colors import diverging_css
from rona_ui.presentation.shown import (
    map_errors,
    map_sigma,
    shown_maps,
    shows_handheld_maps,
)
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import escape

QUANTITIES = {
    "Bone thickness": "thickness",
    "Height above the map plane": "height",
    "Expected boundary error": "sigma",
    "… its part of each place": "sigma_own",
    "… its part common to all": "sigma_common",
    "Expected thickness error": "sigma_thickness",
    "Boundary error to the reference": "error",
    "Thickness error to the reference": "error_thickness",
}
TITLES = {
    "thickness": "Bone thickness",
    "height": "Height",
    "sigma": "Expected error, 1 σ",
    "sigma_own": "Expected error of each place, 1 σ",
    "sigma_common": "Expected error common to all, 1 σ",
    "sigma_thickness": "Expected thickness error, 1 σ",
    "error": "Boundary error (+ too far out)",
    "error_thickness": "Thickness error (+ too thick)",
}
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
        "Detects the outer and inner bone boundary in each A-scan. Unreliable A-scans are "
        "excluded from the maps."
    )
    start = "Map the boundaries"

    def __init__(self, gui: Any, context: PanelContext) -> None:
        super().__init__(gui, context)
        with self.folder:
            self._second = SecondFolder(gui, context, self.message)
            self._sono = HandheldControls(gui, context)
            self._volume = VolumeFolder(gui, context)
            self._comparison = ComparisonFolder(gui, context)
            self._export = ExportFolder(gui, context)

    def build(self) -> None:
        """Add the parameters and the choice of what is shown."""
        self.form.of(StartMapping)
        with self.gui.add_folder("Sound speed calibration", expand_by_default=False):
            self._speed = SpeedFields(self.gui, self.context)
        self._shown = self.gui.add_dropdown("Show", tuple(SHOWN))
        self._quantity = self.gui.add_dropdown("Colour by", tuple(QUANTITIES))
        self._cut = self.gui.add_checkbox(
            "Cut-away window", True, hint="Hides the drawn bone over the region"
        )
        self._bar = self.gui.add_html("")
        with self.gui.add_folder("Error budget", expand_by_default=False):
            self._budget = self.gui.add_html("")
        context = self.context
        on_change(self._shown, lambda e: self._show(SHOWN[e.target.value]))
        on_change(self._quantity, lambda e: context.set_view(quantity=QUANTITIES[e.target.value]))
        on_change(self._cut, lambda e: context.set_view(skull_window=e.target.value))

    def _show(self, names: tuple[str, ...]) -> None:
        hide = MAP_NAMES - set(names)
        self.context.change_view(lambda v: replace(v, hidden=(v.hidden - set(names)) | hide))

    def message(self) -> Any:
        """Return the mapping with these parameters."""
        return StartMapping(**self.form.values())

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the colour bar once there are maps."""
        maps = shown_maps(new)
        if changed(old, new, "session", "busy"):
            self._speed.show(new.session, new.busy)
        self._sono.render(new)
        for field in (self._shown, self._quantity, self._cut):
            field.visible = maps is not None
        if maps is None:
            self._bar.content = ""
        elif changed(old, new, "session.results", "static_scene", "view", "compared", "truth"):
            self._bar.content = color_bar(
                layers_of(maps, new.view.quantity, map_sigma(new), map_errors(new))
            )
        if changed(old, new, "session", "figures", "view"):
            self._budget.content = budget_table(new)
        self._second.render(old, new)
        self._volume.render(old, new)
        self._comparison.render(old, new)
        self._export.render(old, new)

    def remarks(self, snapshot: Snapshot) -> str:
        """Say how much of the inner boundary was found."""
        results, maps = snapshot.session.results, shown_maps(snapshot)
        found = results.sono_detection if shows_handheld_maps(snapshot) else results.detection
        if found is None or maps is None:
            return ""
        value = found.value
        words = (
            f"Outer boundary in {100.0 * float(value.outer_ok.mean()):.0f} %, inner boundary in "
            f"{100.0 * float(value.inner_ok.mean()):.0f} % of {len(value.inner_ok)} A-scans."
        )
        accuracy = accuracy_sentence(snapshot.session, hand=shows_handheld_maps(snapshot))
        if accuracy:
            words += f" {accuracy}"
        if value.method == "subtract":  # the others judge no levels
            words += f" {loss_words(value)}"
        kind = "warn" if judge_bone(value).kind in ("no front", "no echo") else "good"
        return style.note(words, kind) + advice_note(snapshot.session, unless_suits=True)


def budget_table(snapshot: Snapshot) -> str:
    """Return what each cause adds to the error of the robot's maps, predicted and in truth."""
    of_robot = not shows_handheld_maps(snapshot)
    found = budgets(snapshot.session, snapshot.figures) if of_robot else ()
    if not found:
        return style.text("Known once the boundaries of the robot's scan are mapped.")
    html = ""
    for budget in found:
        rows = [
            (
                escape(line.title),
                f"{line.predicted_mm:.3f}",
                "" if line.true_mm is None else f"{line.true_mm:.3f}",
            )
            for line in budget.lines
        ]
        html += style.table(("", "n", "n"), (budget.name, "σ (mm)", "true"), rows)
        if budget.remedy:
            words = f"Largest: {budget.largest}. To lower it: {budget.remedy}."
            html += style.text(words)
    return html


def color_bar(layers: MapLayers) -> str:
    """Return the colour bar with its limits in mm."""
    of_error = layers.quantity.startswith("error")
    fine = of_error or layers.quantity.startswith("sigma")
    title, places = TITLES[layers.quantity], 2 if fine else 1
    low, high = layers.low_mm, layers.high_mm
    values = np.concatenate([layers.part(name).values_mm for name in sorted(MAP_NAMES)])
    below, above = ("≤ " if (values < low).any() else ""), ("≥ " if (values > high).any() else "")
    ticks = (
        f"{below}{low:.{places}f}",
        f"{(low + high) / 2:.{places}f}",
        f"{above}{high:.{places}f}",
    )
    if not len(values):
        return style.text("Nothing is known of it here.")
    gradient = diverging_css() if of_error else None
    return style.color_bar(f"{title} (mm)", *ticks, gradient=gradient)
