"""View options of this browser: camera presets, cut plane and layers."""

from collections.abc import Sequence
from functools import partial
from typing import Any

from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change, on_click
from rona_ui.presentation.camera import HEAD, ROOM, TABLE
from rona_ui.presentation.colors import BONE_RIM, ORANGE, SKY, css
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.view_state import LAYERS, CutDirection

MAPS = ("outer", "inner", "fused")  # chosen in step 9
CUTS: dict[str, CutDirection] = {
    "Off": "off",
    "Lengthwise": "lengthwise",
    "Crosswise": "crosswise",
}
CUT_HINT = (
    "Cuts the drawn skull perpendicular to the region: lengthwise from front to back, or crosswise"
)
CUT_KEY = (
    (css(SKY), "outer boundary"),
    (css(ORANGE), "inner boundary"),
    (css(BONE_RIM), "bone between them, as mapped"),
)
REACH_MM = 60.0  # of the cut to either side of the region's centre; no region is larger


class ViewOptionsPanel:
    """Buttons for the camera, the cut plane, ticks for the layers."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._ticks: dict[str, Any] = {}
        with gui.add_folder("View", expand_by_default=False):
            self._camera(gui, context, "Camera", ROOM)
            names = tuple(HEAD)
            self._head = [
                self._camera(gui, context, "Head", names[:2], visible=False),
                self._camera(gui, context, " ", names[2:], visible=False),
            ]
            self._table = self._camera(gui, context, " ", TABLE)
            self._cut(gui, context)
            hint = "Also layers that the active step does not need"
            all_layers = gui.add_checkbox("All layers", False, hint=hint)
            on_change(all_layers, lambda e: context.set_view(all_layers=e.target.value))
            for name, title in LAYERS.items():
                if name not in MAPS:
                    tick = self._ticks[name] = gui.add_checkbox(title, True)
                    show = partial(context.show_layer, name)
                    on_change(tick, lambda e, show=show: show(e.target.value))

    @staticmethod
    def _camera(
        gui: Any, context: PanelContext, label: str, names: Sequence[str], *, visible: bool = True
    ) -> Any:
        group = gui.add_button_group(label, names, visible=visible)
        on_click(group, lambda e: context.set_camera(group.value))
        return group

    def _cut(self, gui: Any, context: PanelContext) -> None:
        self._across = gui.add_dropdown("Cut", tuple(CUTS), hint=CUT_HINT)
        hint = "From the centre of the region"
        self._at = gui.add_slider(
            "Cut offset (mm)", -REACH_MM, REACH_MM, 0.5, 0.0, visible=False, hint=hint
        )
        hint = "Cuts the maps of step 9 as well"
        self._maps = gui.add_checkbox("Cut maps", False, visible=False, hint=hint)
        self._key = gui.add_html(style.key(CUT_KEY), visible=False)
        on_change(self._across, lambda e: context.set_view(cut_direction=CUTS[e.target.value]))
        on_change(self._at, lambda e: context.set_view(cut_offset_mm=float(e.target.value)))
        on_change(self._maps, lambda e: context.set_view(cut_maps=e.target.value))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the layers, the cut and what is known of the head."""
        if changed(old, new, "view.hidden"):  # only then: a tick may be ahead of the view
            for name, tick in self._ticks.items():
                tick.value = name not in new.view.hidden
        if changed(old, new, "static_scene"):
            known = new.static_scene is not None and new.static_scene.head_axes_base is not None
            for group in self._head:
                group.visible = known
            self._table.visible = not known
        view = new.view
        self._at.visible = self._maps.visible = self._key.visible = view.cut_direction != "off"
        for field in (self._across, self._at, self._maps):
            field.disabled = view.drawing is not None  # the skull is whole while it is drawn on
        if old is not None and changed(old, new, "session.id"):
            # only here: a slider that is being dragged is ahead of the view
            self._across.value = next(w for w, v in CUTS.items() if v == view.cut_direction)
            self._at.value, self._maps.value = view.cut_offset_mm, view.cut_maps
