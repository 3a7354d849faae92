"""Comparison: the robot's maps beside the true bone, or a reference measured by other means."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import Any

from rona_core.app.steps.maps.comparison import TRUTH, MapComparison, Registration
from rona_core.app.steps.maps.messages import StartComparison
from rona_core.errors import InvalidInputError
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, on_change, on_click
from rona_ui.presentation.snapshot import Snapshot, changed, shown_comparison
from rona_ui.presentation.view_state import Pairs, Point, ViewState

FILES = ".stl,.ply,.obj,.nrrd,.nii,.gz,.rona"
EXPLANATION = (
    "Errors along the normal of the maps, in mm; + is too far out, or too thick; σ is what the "
    "maps state. A reference is a mesh (STL, PLY, OBJ; closed: both tables, open: the outer "
    "one), a CT or a mask (NRRD, NIfTI), or another session."
)
LAYINGS = {
    "Is in the robot's base": "none",
    "Lay it under the outer map": "surface",
    "Lay it by pairs of points": "points",
    "By pairs, then under the map": "both",
}
BY_PAIRS = ("points", "both")
LEAST_PAIRS = 3
POINTING = "Click the skull where the point lies."
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
            self._pairs = PairsFolder(gui, context)
            self._threshold = gui.add_number(
                "Bone threshold", ViewState().bone_threshold, step=10.0
            )
            self._file = gui.add_upload_button(
                "Compare with a file…", icon="upload", mime_type=FILES, color="gray"
            )
            self._table = gui.add_html("")
            self._back = gui.add_button("Compare with the true bone", color="gray", visible=False)
        self._file.on_upload(self._take)
        on_click(self._back, lambda e: context.set_view(comparison=None))
        on_change(self._laying, lambda e: self._pairs.show(LAYINGS[self._laying.value] in BY_PAIRS))
        on_change(
            self._threshold,
            lambda e: context.set_view(bone_threshold=float(self._threshold.value)),
        )

    async def _take(self, event: Any) -> None:
        uploaded = self._file.value
        name = PurePath(uploaded.name.replace("\\", "/")).name
        how = LAYINGS[self._laying.value]
        self._context.service(f"compare-{how}:{name}", event, uploaded.content)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the maps and what they are compared with."""
        if not changed(old, new, "session.results", "view", "compared", "truth"):
            return
        self._pairs.render(new)
        self._window.visible = new.session.results.maps is not None
        found = shown_comparison(new)
        self._back.visible = found is not None and found is not new.truth and new.truth is not None
        self._table.content = _words(found)


class PairsFolder:
    """List of pairs of points that a reference is laid by: each in its file, and in ``base``."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self._taken: Point | None = None  # the place that was pointed at, as far as it was followed
        self._folder = gui.add_folder("Pairs of points", visible=False)
        with self._folder:
            self._there = gui.add_vector3("In the file (mm)", (0.0, 0.0, 0.0), step=0.1)
            self._here = gui.add_vector3("In base (mm)", (0.0, 0.0, 0.0), step=0.1)
            context.view_button(gui, "Point at it on the skull", "target", drawing="pair")
            self._hint = gui.add_html("")
            add = gui.add_button("Add the pair", icon="plus", color="gray")
            self._table = gui.add_html("")
            self._which = gui.add_dropdown("Pair", ("1",), visible=False)
            self._remove = gui.add_button("Remove this pair", color="gray", visible=False)
        on_click(add, lambda e: self._add())
        on_click(self._remove, lambda e: self._drop(int(self._which.value) - 1))

    def show(self, shown: bool) -> None:
        """Show the list or not."""
        self._folder.visible = shown

    def _add(self) -> None:
        x, y, z = (float(v) for v in self._there.value)
        u, v, w = (float(v) for v in self._here.value)
        pair = (x, y, z), (u, v, w)
        self._context.change_view(lambda view: replace(view, pairs=(*view.pairs, pair)))

    def _drop(self, index: int) -> None:
        self._context.change_view(
            lambda view: replace(view, pairs=view.pairs[:index] + view.pairs[index + 1 :])
        )

    def render(self, new: Snapshot) -> None:
        """Follow the pairs, the place pointed at, and the result of the comparison."""
        view = new.view
        if view.pair_place is not None and view.pair_place is not self._taken:
            self._here.value = view.pair_place
        self._taken = view.pair_place
        self._hint.content = style.text(POINTING) if view.drawing == "pair" else ""
        names = tuple(str(k + 1) for k in range(len(view.pairs)))
        if names and names != tuple(self._which.options):
            self._which.options = names
        self._which.visible = self._remove.visible = bool(names)
        self._table.content = _pairs_table(view.pairs, _off_mm(new))


def _off_mm(snapshot: Snapshot) -> tuple[float, ...]:
    """Return how far each point was from its partner in the comparison, if it was by these."""
    view = snapshot.view
    place = None if snapshot.compared is None else snapshot.compared.place
    if place is None or place.points_off_mm is None or view.pairs != view.compared_pairs:
        return ()
    return tuple(place.points_off_mm)


def _pairs_table(pairs: Pairs, off_mm: Sequence[float]) -> str:
    """Return the pairs as a table, with what the registration left of each."""
    few = f"{LEAST_PAIRS} pairs or more, not on one line, lay a reference: {len(pairs)} so far."
    need = style.text(few) if len(pairs) < LEAST_PAIRS else ""

    def place(point: Point) -> str:
        return ", ".join(f"{x:.1f}" for x in point)

    rows = [
        (str(k + 1), place(there), place(here), f"{off_mm[k]:.2f}" if off_mm else "–")
        for k, (there, here) in enumerate(pairs)
    ]
    heads = ("", "in the file", "in base", "off, mm")
    return (style.table(("", "", "", "n"), heads, rows) if rows else "") + need


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


def comparison_message(file: str, how: Registration, view: ViewState) -> StartComparison:
    """Return the comparison with an uploaded file; pairs count where it is laid by them.

    Raises:
        InvalidInputError: it is laid by fewer pairs of points than determine a pose.
    """
    pairs, threshold = view.pairs, view.bone_threshold
    if how not in BY_PAIRS:
        return StartComparison(file, how, threshold=threshold)
    if len(pairs) < LEAST_PAIRS:
        raise InvalidInputError(
            f"a reference is laid by {LEAST_PAIRS} pairs of points or more, not {len(pairs)}: add "
            "pairs in step 9, Comparison, Pairs of points"
        )
    there, here = zip(*pairs, strict=True)
    return StartComparison(file, how, there, here, threshold)
