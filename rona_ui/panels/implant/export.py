"""Export: the milling path and the bed as files for another program."""

from typing import Any

from rona_core.app.steps.implant.export import EXPORTS, MOTIONS, offered
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.presentation.snapshot import Snapshot

EXPLANATION = (
    "Milling path in the frame of the bed (mm), as a table or as G-code; body that is milled away "
    "in the robot's base (.stl), and its outline, axis, screws and thinnest place for 3D Slicer "
    "(.mrk.json); certified motion of the robot (rad, s), as a table or, for UR arms, as URScript."
)


class BedExportFolder:
    """Choice of a file, and the button that downloads it."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._window = gui.add_folder("Export", visible=False, expand_by_default=False)
        with self._window:
            gui.add_html(style.text(EXPLANATION))
            without = tuple(one.name for one in EXPORTS if one.name not in MOTIONS)
            self._file = file = gui.add_dropdown("File", without)
            button = gui.add_button("Download bed", icon="download", color="gray")
        on_click(button, lambda e: context.service(f"export:{file.value}", e, None))

    def render(self, new: Snapshot) -> None:
        """Offer files where there is a bed that can be milled."""
        self._window.visible = new.milling is not None
        names = offered(new.session)
        if tuple(self._file.options) != names:
            self._file.options = names
