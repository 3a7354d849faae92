"""Step 10: the bed of an implant is searched or laid by hand; verdict, figures, milling path."""

from dataclasses import replace
from typing import Any

from rona_core.app.overview.bed_figures import (
    LIFT_HEAD,
    SCREW_HEAD,
    bed_rows,
    lift_rows,
    milling_rows,
    screw_rows,
)
from rona_core.app.steps.implant.bed_milling import MillingView
from rona_core.app.steps.implant.implant_bed import ImplantBed
from rona_core.app.steps.implant.messages import StartBedSearch
from rona_core.app.steps.implant.view import verdict
from rona_core.app.steps.maps.view import layers_of
from rona_ui.panels.implant.burr import BurrFields
from rona_ui.panels.implant.by_hand import ASKED, ByHandFolder
from rona_ui.panels.implant.export import BedExportFolder
from rona_ui.panels.implant.lines import LinesFolder
from rona_ui.panels.implant.milling import MillingFolder
from rona_ui.panels.maps.maps import color_bar
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.colors import MILLING_COLORS, css
from rona_ui.presentation.shown import map_errors, map_sigma, opens_window, shown_maps
from rona_ui.presentation.snapshot import Snapshot, changed

SHOWN = {
    "Implant in the bone": ("implant", "bed"),
    "Milling path": ("milling",),
    "Probability of each place": ("chance",),
}
BED_LAYERS = frozenset(name for names in SHOWN.values() for name in names)
NO_CHANCE = "Laid by hand: search the bed to see the probability of each place."


class ImplantPanel(StepPanel):
    """What is asked of the bed; what it leaves of the bone, and how it would be milled."""

    step = "implant"
    explanation = (
        "Finds where the bed most surely leaves enough bone, given the errors of the maps."
    )
    start = "Search the bed"

    def __init__(self, gui: Any, context: PanelContext) -> None:
        super().__init__(gui, context)
        with self.folder:  # below the verdict
            self._shown = gui.add_dropdown("Show", tuple(SHOWN))
            self._window = gui.add_checkbox(
                "Cut-away window", True, hint="Hides the drawn bone over the region"
            )
            self._key = gui.add_html("")
            self._hand = ByHandFolder(gui, context, self.form)
            self._lines = LinesFolder(gui, context)
            self._milling = MillingFolder(gui, context)
            self._figures = gui.add_folder("Figures", visible=False)
            with self._figures:
                self._tables = gui.add_html("")
            with gui.add_folder("Advanced", expand_by_default=False):
                self.form.of(StartBedSearch, "burr_mm")
            self._export = BedExportFolder(gui, context)
        on_change(self._shown, lambda e: self._show(SHOWN[e.target.value]))
        on_change(self._window, lambda e: context.set_view(skull_window=e.target.value))

    def build(self) -> None:
        """Add what is asked of the bed."""
        self._burr = BurrFields(self.gui, self.context)
        self.form.of(StartBedSearch, "implant", "lift_mm", "limit_mm", "probability")

    def _show(self, names: tuple[str, ...]) -> None:
        hide = BED_LAYERS - set(names)
        self.context.change_view(lambda v: replace(v, hidden=(v.hidden - set(names)) | hide))

    def message(self) -> Any:
        """Return the search with these parameters."""
        return StartBedSearch(**self.form.values())

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the bed, and explain the colours of what is shown of it."""
        held = new.session.results.get("bed")
        before = None if old is None else old.session.results.get("bed")
        if held is not None and held is not before:
            searched = held.message == StartBedSearch.__name__
            names = (*ASKED, "lift_mm") if searched else ASKED  # else it is that of the slider
            self.form.show({name: held.arguments.get(name) for name in names})
        self._shown.visible = held is not None
        self._window.visible = held is not None and not new.view.shows("chance")
        if changed(old, new, "view.skull_window"):
            self._window.value = new.view.skull_window
        if changed(old, new, "session", "view", "static_scene", "compared", "truth"):
            self._key.content = "" if held is None else _key(new)
        self._figures.visible = held is not None and held.value.placed is not None
        if changed(old, new, "session.results", "milling"):
            self._tables.content = "" if held is None else _tables(held.value, new.milling)
        self._burr.render(old, new)
        self._hand.render(old, new)
        self._lines.render(old, new)
        self._milling.render(old, new)
        self._export.render(new)

    def remarks(self, snapshot: Snapshot) -> str:
        """Return the verdict, and the lifts that were tried."""
        held = snapshot.session.results.get("bed")
        if held is None:
            return ""
        bed: ImplantBed = held.value
        note = style.note(verdict(bed), "good" if bed.refusal is None else "warn")
        rows = [(*cells, style.verdict(kept)) for *cells, kept in lift_rows(bed)]
        return note + (style.table(("", "n", "n"), LIFT_HEAD, rows) if rows else "")


def _tables(bed: ImplantBed, milling: MillingView | None) -> str:
    """Return the figures of the bed, and of its milling where it lies wholly in the maps."""
    placed, html = bed.placed, ""
    if placed is not None:
        html = style.table(("", "n"), ("Bed", ""), bed_rows(bed, placed))
        if placed.screws:
            html += style.table(("", "n", "n", "n"), SCREW_HEAD, screw_rows(placed))
    if milling is not None:
        html += style.table(("", "n"), ("Milling", ""), milling_rows(milling))
    return html


def _key(snapshot: Snapshot) -> str:
    """Return what the colours of the shown layers mean."""
    view, held, maps = snapshot.view, snapshot.session.results.get("bed"), shown_maps(snapshot)
    html = ""
    if view.shows("milling"):
        html += style.key(tuple((css(color), word) for word, color in MILLING_COLORS.values()))
    if opens_window(view) and view.shows("inner") and maps is not None:
        layers = layers_of(maps, view.quantity, map_sigma(snapshot), map_errors(snapshot))
        html += color_bar(layers)
    if held is None or not view.shows("chance"):
        return html
    if held.value.probability is None:
        return html + style.text(NO_CHANCE)
    bar = style.color_bar("Probability with the middle of the bed here", "0 %", "50 %", "100 %")
    return html + bar + style.text("White dots: safe. Orange ring: the bed.")
