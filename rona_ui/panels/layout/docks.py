"""Docks of one browser: procedure on the left, figures and graphs on the right, replay."""

from typing import Any

from rona_ui.panels.implant.implant import ImplantPanel
from rona_ui.panels.layout.frames_and_log import FramesPanel, LogPanel
from rona_ui.panels.layout.page_link import PageLink
from rona_ui.panels.layout.quality import QualityPanel
from rona_ui.panels.layout.refused import Refused
from rona_ui.panels.layout.replay_bar import ReplayPanel
from rona_ui.panels.layout.run_bar import RunBar, StepList, StepTitle
from rona_ui.panels.maps.maps import MapsPanel
from rona_ui.panels.path.path import PathPanel
from rona_ui.panels.path.path_graph import PathGraph
from rona_ui.panels.pointer import PointerPanel
from rona_ui.panels.roll.certificate import ChecksPanel
from rona_ui.panels.roll.joints_graph import JointsPanel
from rona_ui.panels.roll.roll import RollPanel
from rona_ui.panels.roll.roll_browser import RollsPanel
from rona_ui.panels.scan.ascan import AScanPanel
from rona_ui.panels.scan.force_graph import ForcePanel
from rona_ui.panels.scan.scan import ScanPanel
from rona_ui.panels.setup.probe import ProbeComparisonPanel
from rona_ui.panels.setup.setup import SetupPanel
from rona_ui.panels.smoothing import SmoothingPanel
from rona_ui.panels.surface import SurfacePanel
from rona_ui.panels.tool.calibration import CalibrationPanel
from rona_ui.panels.tool.tool import ToolPanel
from rona_ui.panels.widgets.panel_context import Panel, PanelContext
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.resources import static_dir

STEP_PANELS: tuple[type[StepPanel], ...] = (
    SetupPanel,
    ToolPanel,
    PointerPanel,
    SurfacePanel,
    PathPanel,
    SmoothingPanel,
    RollPanel,
    ScanPanel,
    MapsPanel,
    ImplantPanel,
)
TABS = {  # of the right dock that go with a step: the upper one, the lower one
    "setup": ("Quality", "Probes"),
    "tool": ("Quality", "Poses"),
    "pointer": ("Quality", "Poses"),
    "surface": ("Quality", "Path"),
    "path": ("Quality", "Path"),
    "smoothing": ("Quality", "Path"),
    "roll": ("Rolls", "Joints"),
    "scan": ("Quality", "A-scan"),
    "maps": ("Quality", "A-scan"),
    "implant": ("Quality", "A-scan"),
}
LEFT_PX, RIGHT_PX, REPLAY_PX = 340, 380, 430


class TabsOfStep:
    """Tells the page which tabs go with the active step; it opens them (``static/docks.js``)."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html("")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the active step."""
        if changed(old, new, "view.step"):
            step = new.view.step
            tabs = ",".join(TABS[step])
            self._html.content = f'<i hidden data-step="{step}" data-step-tabs="{tabs}"></i>'


class Docks:
    """Builds every panel once and draws snapshots into them."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        gui.set_panel_label("Procedure")
        left = gui.main_panel
        left.dock_left()
        left.set_width(LEFT_PX)
        sheet = (static_dir() / "docks.css").read_text("utf-8")
        gui.add_html(f"<style>{sheet}</style>")
        step_list = StepList(gui, context)
        panels: list[Panel] = [step_list, StepTitle(gui), TabsOfStep(gui)]
        steps: dict[str, StepPanel] = {}
        run_bar = RunBar(gui, context, steps)  # above the fields, so that it never scrolls away
        panels.append(Refused(gui))
        steps.update({kind.step: kind(gui, context) for kind in STEP_PANELS})
        panels += [*steps.values(), run_bar]
        panels.append(PageLink(gui, context, {**step_list.buttons, **run_bar.buttons}))
        panels += self._right(gui, context)
        replay = gui.add_panel(visible=False)
        with replay.add_tab("Replay", "player-play"):
            panels.append(ReplayPanel(gui, context, replay))
        replay.float(x=16, y=-16, width=REPLAY_PX)
        replay.minimize()  # it would hide the lower part of the region
        self._panels = tuple(panels)

    @staticmethod
    def _right(gui: Any, context: PanelContext) -> list[Panel]:
        upper, lower = gui.add_panel(), gui.add_panel()
        panels: list[Panel] = []
        for dock, title, icon, build in (
            (upper, "Quality", "gauge", lambda: QualityPanel(gui)),
            (upper, "Rolls", "rotate-360", lambda: RollsPanel(gui, context)),
            (upper, "Frames", "axis-x", lambda: FramesPanel(gui)),
            (upper, "Log", "list", lambda: LogPanel(gui)),
            (lower, "Poses", "crosshair", lambda: CalibrationPanel(gui, context)),
            (lower, "Path", "route", lambda: PathGraph(gui)),
            (lower, "Joints", "chart-line", lambda: JointsPanel(gui, context)),
            (lower, "Checks", "shield-check", lambda: ChecksPanel(gui, context)),
            (lower, "A-scan", "wave-sine", lambda: AScanPanel(gui, context)),
            (lower, "Force", "arrow-bar-to-down", lambda: ForcePanel(gui, context)),
            (lower, "Probes", "flask", lambda: ProbeComparisonPanel(gui, context)),
        ):
            with dock.add_tab(title, icon):
                panels.append(build())
        upper.dock_right()
        lower.dock_below(upper)
        upper.set_width(RIGHT_PX)
        return panels

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Bring every panel from ``old`` to ``new``."""
        for panel in self._panels:
            panel.render(old, new)
