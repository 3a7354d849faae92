"""3D volume: slices and an iso-surface of the echoes of all A-scans, drawn on demand."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.maps.volume import volume_agreement
from rona_core.errors import RonaError
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, on_change
from rona_ui.presentation.colors import ORANGE, SKY, css
from rona_ui.presentation.snapshot import Snapshot, changed, shown_volume, shows_handheld_maps
from rona_ui.presentation.view_state import VolumeView

EXPLANATION = (
    "Echo amplitudes of all A-scans as one volume in the frame of the maps, in dB over the front "
    "echo of flat bone."
)
GAIN_HINT = "Makes up for the loss on the way through the bone"
DEPTH_HINT = "Sheet that follows the outer boundary this far below it"
KEY = ((css(SKY), "outer boundary"), (css(ORANGE), "echoes below it"))
USUAL = VolumeView(None)


class VolumeFolder:
    """Fields of the volume of the robot's maps."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self._maps: Any = None  # the result that is looked at
        self._window = gui.add_folder("3D volume", visible=False, expand_by_default=False)
        with self._window:
            gui.add_html(style.text(EXPLANATION))
            slices = gui.add_checkbox("Slices", False)
            u = gui.add_slider("u (mm)", -30.0, 30.0, 0.5, 0.0)
            v = gui.add_slider("v (mm)", -30.0, 30.0, 0.5, 0.0)
            depth = gui.add_slider("Depth (mm)", 0.0, 13.0, 0.25, USUAL.depth_mm, hint=DEPTH_HINT)
            surface = gui.add_checkbox("Iso-surface", False)
            level = gui.add_slider("Level (dB)", -50.0, -6.0, 1.0, USUAL.level_db)
            gain = gui.add_slider(
                "Gain (dB/mm)", 0.0, 4.0, 0.25, USUAL.gain_db_per_mm, hint=GAIN_HINT
            )
            self._words = gui.add_html("")
        self._ticks, self._of_slices, self._of_surface = (slices, surface), (u, v, depth), (level,)
        self._gain = gain
        fields = {"slices": slices, "surface": surface, "u_mm": u, "v_mm": v, "depth_mm": depth}
        for name, field in (*fields.items(), ("level_db", level), ("gain_db_per_mm", gain)):
            on_change(field, lambda e, name=name: self._show(**{name: e.target.value}))

    def _show(self, **fields: Any) -> None:
        maps = self._maps

        def change(view: Any) -> Any:
            held = view.volume
            base = held if held is not None and held.maps is maps else VolumeView(maps)
            return replace(view, volume=replace(base, **fields))

        self._context.change_view(change)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the maps and what is shown of their volume."""
        if not changed(old, new, "session", "view"):
            return
        maps = None if shows_handheld_maps(new) else new.session.results.maps
        self._window.visible = maps is not None
        if maps is not self._maps:
            self._maps = maps
            for tick in self._ticks:
                tick.value = False
            for field, axis in zip(self._of_slices, ("u_mm", "v_mm"), strict=False):
                if maps is not None:
                    places = getattr(maps.value.outer, axis)
                    field.min, field.max = float(places[0]), float(places[-1])
        shown = shown_volume(new)
        for field in self._of_slices:
            field.visible = shown is not None and shown.slices
        for field in self._of_surface:
            field.visible = shown is not None and shown.surface
        self._gain.visible = shown is not None
        self._words.content = "" if shown is None else _words(new, shown)


def _words(snapshot: Snapshot, shown: VolumeView) -> str:
    """Return the legend, and how the ridge in the volume lies beside the inner map."""
    try:
        found = volume_agreement(snapshot.session)
    except RonaError as error:
        return style.note(f"{error}.", "warn")
    html = style.key(KEY) if shown.surface else ""
    if found is None:
        return html + style.note("No ridge of the inner boundary stands out of the noise.", "warn")
    return html + style.text(
        f"Thickness read from the volume, in {100.0 * found.share:.0f} % of the columns, against "
        f"the maps: median {found.median_mm:+.2f} mm, 95 % within {found.p95_abs_mm:.2f} mm."
    )
