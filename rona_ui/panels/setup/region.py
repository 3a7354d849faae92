"""Place of the scan region in step 1: by a click on the skull, or chosen by the program."""

from typing import Any

from rona_core.app.steps.setup.messages import SetRegion
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.presentation.snapshot import Snapshot

HELP = "Click the skull where the centre of the region is to be. Drag to rotate the view."


class RegionControls:
    """Buttons to pick the centre of the region, to leave that, and to take the program's again."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self._radius_mm = 25.0
        self.center_mesh_mm: tuple[float, float, float] | None = None
        hint = "Place the scan region by a click on the skull"
        self._pick = gui.add_button("Pick region", icon="target", color="gray", hint=hint)
        self._help = gui.add_html("")
        self._cancel = context.view_button(gui, "Cancel picking", "x", drawing=None, picks=())
        self._reset = context.send_button(
            gui, "Reset region", "restore", lambda: SetRegion(None, self._radius_mm)
        )
        on_click(self._pick, self._begin)

    def _begin(self, event: Any) -> None:
        self._context.set_view(drawing="region", picks=())

    def render(self, new: Snapshot) -> None:
        """Follow the session and what is being picked."""
        region, picking = new.session.setup.region, new.view.drawing == "region"
        self.center_mesh_mm, self._radius_mm = region.center_mesh_mm, region.radius_mm
        self._pick.visible, self._cancel.visible = not picking, picking
        self._reset.visible = not picking and region.center_mesh_mm is not None
        self._pick.disabled = self._reset.disabled = new.busy
        self._help.content = style.note(HELP) if picking else ""
