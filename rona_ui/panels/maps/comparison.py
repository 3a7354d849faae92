"""Comparison: the robot's maps beside the true bone, or beside a reference of somebody else."""

from pathlib import PurePath
from typing import Any

from rona_core.app.steps.maps.comparison import TRUTH, MapComparison
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.presentation.shown import shown_comparison
from rona_ui.presentation.snapshot import Snapshot, changed

FILES = ".stl,.ply,.obj,.rona"
EXPLANATION = (
    "Errors along the normal of the maps, in mm; + is too far out, or too thick; σ is what the "
    "maps state. A reference is a mesh (STL, PLY, OBJ; closed: both tables, open: the outer "
    "one) or another session."
)
LAYINGS = {"Is in the robot's base": "none", "Lay it under the outer map": "surface"}
TITLES = {
    "outer": "Outer",
    "fused": "Outer, fused",
    "inner": "Inner",
    "thickness": "Thickness",
    "thickness_nearest": "… to the nearest",
}
RIGID = "Laid under the outer map: what the whole map is off by, and a tilt of it, can not be seen."


class ComparisonFolder:
    """Choice of a reference, and the figures against it."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self._window = gui.add_folder("Comparison", visible=False, expand_by_default=False)
        with self._window:
            gui.add_html(style.text(EXPLANATION))
            self._laying = gui.add_dropdown("Reference", tuple(LAYINGS))
            self._file = gui.add_upload_button(
                "Compare with a file…", icon="upload", mime_type=FILES, color="gray"
            )
            self._table = gui.add_html("")
            self._back = gui.add_button("Compare with the true bone", color="gray", visible=False)
        self._file.on_upload(self._take)
        on_click(self._back, lambda e: context.set_view(comparison=None))

    async def _take(self, event: Any) -> None:
        uploaded = self._file.value
        name = PurePath(uploaded.name.replace("\\", "/")).name
        how = LAYINGS[self._laying.value]
        self._context.service(f"compare-{how}:{name}", event, uploaded.content)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the maps and what they are compared with."""
        if not changed(old, new, "session.results", "view", "truth"):
            return
        self._window.visible = new.session.results.maps is not None
        found = shown_comparison(new)
        self._back.visible = found is not None and found is not new.truth and new.truth is not None
        self._table.content = _words(found)


def _words(found: MapComparison | None) -> str:
    """Return the figures as a table, and how the reference was laid."""
    if found is None:
        return style.text("Nothing to compare with: choose a file.")
    rows = [
        (
            TITLES[row.name],
            f"{100.0 * row.coverage:.0f}",
            *(
                "–" if size is None else f"{size:z.2f}"
                for size in (row.bias_mm, row.rms_mm, row.p95_mm, row.stated_mm)
            ),
        )
        for row in found.figures
    ]
    whose = "True bone" if found.name == TRUTH else found.name
    html = style.text(f"Reference: {whose}") + style.table(
        ("", "n", "n", "n", "n", "n"), ("mm", "%", "bias", "RMS", "95 %", "σ"), rows
    )
    fit = None if found.place is None else found.place.surface
    if fit is None:
        return html
    kind = "good" if fit.verdict == "good" else "warn"
    words = "; ".join((f"Fit {fit.verdict}, RMS {fit.rms_mm:.2f} mm", *fit.reasons))
    return html + style.note(f"{words}. {RIGID}", kind)
