"""Docks of one browser: procedure on the left, figures and graphs on the right, replay."""

from typing import Any

from rona_ui.panels.layout.frames_and_log import FramesPanel, LogPanel
from rona_ui.panels.layout.quality import QualityPanel
from rona_ui.panels.layout.replay_bar import ReplayPanel
from rona_ui.panels.layout.run_bar import RunBar, StepList, StepTitle
from rona_ui.panels.layout.session import SessionHead, SessionPanel
from rona_ui.panels.layout.view_options import ViewOptionsPanel
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
from rona_ui.panels.setup.probe_sweep import ProbeComparisonPanel
from rona_ui.panels.setup.setup import SetupPanel
from rona_ui.panels.smoothing import SmoothingPanel
from rona_ui.panels.surface import SurfacePanel
from rona_ui.panels.tool.tool import ToolPanel
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import Panel, PanelContext
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.snapshot import Snapshot

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
)
LEFT_PX, RIGHT_PX, REPLAY_PX = 340, 380, 430


class Docks:
    """Builds every panel once and draws snapshots into them."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        gui.set_panel_label("Procedure")
        left = gui.main_panel
        left.dock_left()
        left.set_width(LEFT_PX)
        gui.add_html(style.SHEET)
        panels: list[Panel] = [SessionHead(gui), StepList(gui, context), StepTitle(gui)]
        steps: dict[str, StepPanel] = {}
        run_bar = RunBar(gui, context, steps)  # above the fields, so that it never scrolls away
        steps.update({kind.step: kind(gui, context) for kind in STEP_PANELS})
        panels += [*steps.values(), run_bar]
        self._session = SessionPanel(gui, context)
        panels += [ViewOptionsPanel(gui, context), self._session]
        panels += self._right(gui, context)
        replay = gui.add_panel(visible=False)
        with replay.add_tab("Replay", "player-play"):
            panels.append(ReplayPanel(gui, context, replay))
        replay.float(x=16, y=-16, width=REPLAY_PX)
        self._panels = tuple(panels)

    @staticmethod
    def _right(gui: Any, context: PanelContext) -> list[Panel]:
        upper, lower = gui.add_panel(), gui.add_panel()
        panels: list[Panel] = []
        with upper.add_tab("Quality", "gauge"):
            panels.append(QualityPanel(gui))
        with upper.add_tab("Rolls", "rotate-360"):
            panels.append(RollsPanel(gui, context))
        with upper.add_tab("Frames", "axis-x"):
            panels.append(FramesPanel(gui))
        with upper.add_tab("Log", "list"):
            panels.append(LogPanel(gui))
        with lower.add_tab("Path", "route"):
            panels.append(PathGraph(gui))
        with lower.add_tab("Joints", "chart-line"):
            panels.append(JointsPanel(gui, context))
        with lower.add_tab("Checks", "shield-check"):
            panels.append(ChecksPanel(gui, context))
        with lower.add_tab("A-scan", "wave-sine"):
            panels.append(AScanPanel(gui, context))
        with lower.add_tab("Force", "arrow-bar-to-down"):
            panels.append(ForcePanel(gui, context))
        with lower.add_tab("Probes", "flask"):
            panels.append(ProbeComparisonPanel(gui, context))
        upper.dock_right()
        lower.dock_below(upper)
        upper.set_width(RIGHT_PX)
        return panels

    def cancel_question(self) -> bool:
        """Answer what is asked over the viewer with Cancel; return whether something was asked."""
        return self._session.cancel_question()

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Bring every panel from ``old`` to ``new``."""
        for panel in self._panels:
            panel.render(old, new)
