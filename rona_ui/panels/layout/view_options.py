"""How this browser looks at the scene: camera presets, cut plane and layers."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change, on_click
from rona_ui.presentation.camera import HEAD, ROOM, TABLE
from rona_ui.presentation.colors import BONE_RIM, ORANGE, SKY, css
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import LAYERS, CutDirection, ViewState

MAPS = ("outer", "inner", "fused")  # chosen in step 9
CUTS: dict[str, CutDirection] = {
    "Off": "off",
    "Lengthwise": "lengthwise",
    "Crosswise": "crosswise",
}
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
            all_layers = gui.add_checkbox(
                "All layers", False, hint="Also layers that the active step does not need"
            )
            on_change(
                all_layers,
                lambda e: context.change_view(lambda v: replace(v, all_layers=all_layers.value)),
            )
            for name, title in LAYERS.items():
                if name not in MAPS:
                    self._ticks[name] = gui.add_checkbox(title, True)
                    self._layer(name, self._ticks[name], context)

    @staticmethod
    def _camera(
        gui: Any, context: PanelContext, label: str, names: Sequence[str], *, visible: bool = True
    ) -> Any:
        group = gui.add_button_group(label, names, visible=visible)
        on_click(group, lambda e: context.set_camera(group.value))
        return group

    def _cut(self, gui: Any, context: PanelContext) -> None:
        across = self._across = gui.add_dropdown(
            "Cut",
            tuple(CUTS),
            hint=(
                "Cuts the drawn skull perpendicular to the region: lengthwise from front to "
                "back, or crosswise"
            ),
        )
        at = self._at = gui.add_slider(
            "Cut offset (mm)",
            -REACH_MM,
            REACH_MM,
            0.5,
            0.0,
            visible=False,
            hint="From the centre of the region",
        )
        maps = self._maps = gui.add_checkbox(
            "Cut maps",
            False,
            visible=False,
            hint="Cuts the maps of step 9 as well",
        )
        self._key = gui.add_html(style.key(CUT_KEY), visible=False)
        on_change(
            across,
            lambda e: context.change_view(lambda v: replace(v, cut_direction=CUTS[across.value])),
        )
        on_change(
            at, lambda e: context.change_view(lambda v: replace(v, cut_offset_mm=float(at.value)))
        )
        on_change(maps, lambda e: context.change_view(lambda v: replace(v, cut_maps=maps.value)))

    @staticmethod
    def _layer(name: str, tick: Any, context: PanelContext) -> None:
        def change(event: Any) -> None:
            only = frozenset((name,))
            context.change_view(
                lambda v: replace(v, hidden=v.hidden - only if tick.value else v.hidden | only)
            )

        on_change(tick, change)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the layers, the cut and what is known of the head."""
        if old is None or old.view.hidden != new.view.hidden:
            for name, tick in self._ticks.items():
                tick.value = name not in new.view.hidden
        if old is None or old.static_scene is not new.static_scene:
            known = new.static_scene is not None and new.static_scene.head_axes_base is not None
            for group in self._head:
                group.visible = known
            self._table.visible = not known
        self._follow_cut(old, new.view)
        if old is not None and old.session.id != new.session.id:
            # only here: a slider that is being dragged is ahead of the view
            self._across.value = next(w for w, v in CUTS.items() if v == new.view.cut_direction)
            self._at.value, self._maps.value = new.view.cut_offset_mm, new.view.cut_maps

    def _follow_cut(self, old: Snapshot | None, view: ViewState) -> None:
        """Show the slider while there is a cut; fields rest while somebody draws on the skull."""
        seen, drawing = view.cut_direction != "off", view.drawing is not None
        if old is None or (old.view.cut_direction != "off") != seen:
            self._at.visible = self._maps.visible = self._key.visible = seen
        if old is None or (old.view.drawing is not None) != drawing:
            for field in (self._across, self._at, self._maps):
                field.disabled = drawing
