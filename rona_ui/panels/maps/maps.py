"""Step 9: boundaries are detected, mapped and fused with the cloud; tilted passes."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.declarations.declarations import USABLE
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.acoustics.view import loss_words
from rona_core.app.steps.maps.export import EXPORTS
from rona_core.app.steps.maps.inputs import accuracy_sentence, budgets
from rona_core.app.steps.maps.messages import StartMapping, StartTiltPlan, StartTiltScan
from rona_core.app.steps.maps.view import (
    MapLayers,
    SecondView,
    layers_of,
    second_cells,
    second_view,
)
from rona_core.app.steps.scan.inputs import usable_second
from rona_ui.panels.acoustics import SpeedFields
from rona_ui.panels.handheld import HandheldControls
from rona_ui.panels.maps.comparison import ComparisonFolder
from rona_ui.panels.maps.volume import VolumeFolder
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form, PanelContext, on_change, on_click
from rona_ui.panels.widgets.step_panel import (
    ExportFolder,
    JudgementNote,
    StepPanel,
    judged,
    stopped_note,
)
from rona_ui.presentation.colors import SKY, css, diverging_css
from rona_ui.presentation.snapshot import (
    Snapshot,
    changed,
    map_errors,
    map_sigma,
    shown_maps,
    shows_handheld_maps,
    shows_second_path,
)
from rona_ui.viewer.bindings import escape

EXPLANATION = (
    "Meshes (.ply, .stl, .vtp with σ at every corner), images (.nrrd, .seg.nrrd), markups and a "
    "table, in the robot's base frame, in mm. maps.zip holds all of them."
)


class MapExportFolder(ExportFolder):
    """Files of the maps."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        names = tuple(one.name for one in EXPORTS)
        super().__init__(gui, context, names, words=EXPLANATION, button="Download maps")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the maps; stale ones are not exported."""
        if changed(old, new, "session"):
            there = new.session.results.maps is not None
            self.show(there=there, reason=stale_reason("maps", new.session))


TILTED_PASSES = (
    "Where the inner table is inclined, its echo misses an upright probe. The robot scans the path "
    "again with the probe tilted, each time another way; what several passes agree on is mapped."
)


class SecondFolder:
    """Plan, scan and map the tilted passes, and what came of them."""

    def __init__(
        self, gui: Any, context: PanelContext, mapping: Callable[[], StartMapping]
    ) -> None:
        self._form = Form(gui)
        self._window = gui.add_folder("Tilted passes", visible=False)
        with self._window:
            gui.add_html(style.text(TILTED_PASSES))
            self._words = gui.add_html("")
            self._plan = gui.add_button("Plan tilted passes", icon="route")
            self._scan = gui.add_button("Scan tilted pass", icon="player-play")
            self._map = gui.add_button("Map with tilted passes", icon="map", visible=False)
            with gui.add_folder("Tilt and number", expand_by_default=False):
                self._form.of(StartTiltPlan, "tilt_deg", "passes")
        on_click(self._plan, lambda e: self._send(context, self.message, e))
        on_click(self._scan, lambda e: self._send(context, StartTiltScan, e))
        on_click(self._map, lambda e: self._send(context, mapping, e, second=False))

    def message(self) -> StartTiltPlan:
        """Return the planning with these parameters."""
        return StartTiltPlan(**self._form.values())

    @staticmethod
    def _send(context: PanelContext, make: Any, event: Any, *, second: bool = True) -> None:
        context.send(make, event)
        context.set_view(second=second, cursor=None, playing=False)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow maps, plan and scan of the tilted passes."""
        if not changed(old, new, "session", "busy", "view.second"):
            return
        self._form.enable(not new.busy)
        self._window.visible = new.session.results.maps is not None
        view = second_view(new.session)
        left = view is not None and view.blocked is None and not view.scanned
        self._plan.disabled = new.busy
        self._scan.disabled = new.busy or not left
        scanned = bool(usable_second(new.session))
        self._plan.label = "Plan tilted passes" if view is None else "Plan tilted passes again"
        if view is not None and not view.scanned:
            self._scan.label = f"Scan tilted pass {view.done + 1} of {view.count}"
        else:
            self._scan.label = "Scan tilted pass"
        self._plan.color = None if view is None or view.blocked is not None else "gray"
        self._scan.color = None if left else "gray"
        self._map.visible = scanned and second_cells(new.session) is None
        self._map.disabled = new.busy
        self._words.content = second_pass_words(new, view, scanned)


def second_pass_words(snapshot: Snapshot, view: SecondView | None, scanned: bool) -> str:
    """Return what is planned, what all passes scanned, and the coverage before and after."""
    session, html = snapshot.session, stopped_note(snapshot, "StartTiltScan")
    if view is not None:
        most_deg = view.lean_deg.max(initial=0.0)
        many = "1 pass" if view.count == 1 else f"{view.count} passes"
        text = f"{many} of {view.length_mm:.0f} mm, probe tilt up to {most_deg:.1f}°"
        if view.blocked is not None:
            html += style.note(f"{text}. Cannot be scanned: {view.blocked}.", "warn")
        elif view.stale is not None and not view.scanned:
            html += style.note(f"{text}. Stale: {view.stale}. Plan again.", "warn")
        else:
            text += f", {view.duration_s or 0.0:.0f} s in all; {view.done} of {view.count} scanned"
            html += style.note(f"{text}.")
        if shows_second_path(snapshot):
            html += style.key(((css(SKY), "next tilted pass, with axes of the probe"),))
    passes = session.captures.second
    if not passes:
        return html
    if not scanned:
        return html + style.note(
            "The tilted passes belong to another scan. Scan them again.", "warn"
        )
    n_scans = sum(len(one.scans) for one in passes)
    cells = second_cells(session)
    if cells is None:
        return html + style.note(
            f"{n_scans} A-scans of tilted passes recorded. Map the boundaries with them."
        )
    which = "the tilted pass" if len(passes) == 1 else f"{len(passes)} tilted passes"
    before = max(0.0, cells.before)
    return html + style.note(
        f"Inner boundary below {100 * before:.0f} % of the mapped outer one before, "
        f"{100 * cells.after:.0f} % with {which} ({n_scans} A-scans). White dots: cells "
        f"seen only by {which}.",
        "good",
    )


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
            self._export = MapExportFolder(gui, context)

    def build_result(self) -> None:
        """Add the colour bar, and the choice of what is shown."""
        self._judged = JudgementNote(self.gui, self.context)
        self._bar = self.gui.add_html("")
        self._shown = self.gui.add_dropdown("Show", tuple(SHOWN))
        self._quantity = self.gui.add_dropdown("Colour by", tuple(QUANTITIES))
        self._cut = self.gui.add_checkbox(
            "Cut-away window", True, hint="Hides the drawn bone over the region"
        )
        self._accuracy = self.gui.add_html("")
        context = self.context
        on_change(self._shown, lambda e: self._show(SHOWN[e.target.value]))
        on_change(self._quantity, lambda e: context.set_view(quantity=QUANTITIES[e.target.value]))
        on_change(self._cut, lambda e: context.set_view(skull_window=e.target.value))

    def build(self) -> None:
        """Add the parameters."""
        self.form.of(StartMapping)
        with self.gui.add_folder("Error budget", expand_by_default=False):
            self._budget = self.gui.add_html("")
        with self.gui.add_folder("Sound speed calibration", expand_by_default=False):
            self._speed = SpeedFields(self.gui, self.context)

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
        if changed(old, new, "session", "busy", "figures", "judged"):
            found = judge_part("maps", new.session)
            listed = any(found.reason in row.sentence for row in judged(new, "maps").missed)
            short = found.state in ("weak", "bad") and not listed
            words = f"{style.sentence(found.reason)}." if short else ""
            self._judged.show(words, found if short else USABLE, busy=new.busy)
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
            self._accuracy.content = accuracy_note(new)
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
            f"Outer boundary in {100.0 * float(value.outer_ok.mean()):.0f} % of "
            f"{len(value.outer_ok)} A-scans, inner boundary below {100.0 * maps.inner_share:.0f} % "
            "of the mapped outer one."
        )
        return style.note(words, "good" if value.inner_ok.any() else "warn")


def accuracy_note(snapshot: Snapshot) -> str:
    """Return how accurate the shown maps should be, and how much the bone absorbs."""
    results, hand = snapshot.session.results, shows_handheld_maps(snapshot)
    found = results.sono_detection if hand else results.detection
    if found is None or shown_maps(snapshot) is None:
        return ""
    words = [accuracy_sentence(snapshot.session, hand=hand)]
    if found.value.method == "subtract":  # the others judge no levels
        words.append(loss_words(found.value))
    return style.text(" ".join(filter(None, words)))


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
