"""Export: the robot's maps as a file for another program."""

from typing import Any

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.maps.export import EXPORTS
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.presentation.snapshot import Snapshot, changed

EXPLANATION = (
    "Meshes (.ply, .stl, .vtp with σ at every corner), images (.nrrd, .seg.nrrd), markups and a "
    "table, in the robot's base frame, in mm. maps.zip holds all of them."
)


class ExportFolder:
    """Choice of a file, and the button that downloads it."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._window = gui.add_folder("Export", visible=False, expand_by_default=False)
        with self._window:
            gui.add_html(style.text(EXPLANATION))
            file = gui.add_dropdown("File", tuple(one.name for one in EXPORTS))
            self._words = gui.add_html("")
            self._button = gui.add_button("Download maps", icon="download", color="gray")
        on_click(self._button, lambda e: context.service(f"export:{file.value}", e, None))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the maps; stale ones are not exported."""
        if not changed(old, new, "session"):
            return
        self._window.visible = new.session.results.maps is not None
        reason = stale_reason("maps", new.session)
        self._button.disabled = reason is not None
        self._words.content = (
            "" if reason is None else style.note(f"Not exported: {reason}.", "warn")
        )
