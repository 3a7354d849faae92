"""Docks of one browser: procedure on the left, figures and graphs on the right, replay."""

from collections.abc import Callable, Iterable
from typing import Any

from rona_ui.panels.implant.implant import ImplantPanel
from rona_ui.panels.layout.bars import ReplayPanel, RunBar, StepList, StepTitle
from rona_ui.panels.layout.frames_and_log import DrawingErrors, FramesPanel, LogPanel, Refused
from rona_ui.panels.layout.page_link import PageLink
from rona_ui.panels.layout.quality import QualityPanel
from rona_ui.panels.maps.maps import MapsPanel
from rona_ui.panels.path.path import PathPanel
from rona_ui.panels.path.smoothed_path import PathGraph
from rona_ui.panels.pointer import PointerPanel
from rona_ui.panels.roll.joints_graph import JointsPanel
from rona_ui.panels.roll.roll import ChecksPanel, RollPanel
from rona_ui.panels.roll.roll_browser import RollsPanel
from rona_ui.panels.scan.ascan import AScanPanel
from rona_ui.panels.scan.scan import ForcePanel, ScanPanel
from rona_ui.panels.setup.probe import ProbeComparisonPanel
from rona_ui.panels.setup.setup import SetupPanel
from rona_ui.panels.smoothing import SmoothingPanel
from rona_ui.panels.surface import SurfacePanel
from rona_ui.panels.tool.calibration import CalibrationPanel
from rona_ui.panels.tool.tool import ToolPanel
from rona_ui.panels.widgets.form import PanelContext
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.error_boundary import Drawable, ErrorBoundary
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.resources import static_dir

STEP_PANELS: dict[str, type[StepPanel]] = {
    kind.step: kind
    for kind in (
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
}
Build = Callable[[Any, PanelContext], Drawable]
UPPER_TABS: dict[str, tuple[str, Build]] = {  # of the right dock: icon, and what the tab shows
    "Quality": ("gauge", lambda gui, context: QualityPanel(gui)),
    "Rolls": ("rotate-360", RollsPanel),
    "Frames": ("axis-x", lambda gui, context: FramesPanel(gui)),
    "Log": ("list", lambda gui, context: LogPanel(gui)),
}
LOWER_TABS: dict[str, tuple[str, Build]] = {
    "Poses": ("crosshair", CalibrationPanel),
    "Path": ("route", lambda gui, context: PathGraph(gui)),
    "Joints": ("chart-line", JointsPanel),
    "Checks": ("shield-check", ChecksPanel),
    "A-scan": ("wave-sine", AScanPanel),
    "Force": ("arrow-bar-to-down", ForcePanel),
    "Probes": ("flask", ProbeComparisonPanel),
}
TAB_PANELS: dict[str, Build] = {
    name: build for name, (_, build) in (*UPPER_TABS.items(), *LOWER_TABS.items())
}
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
    """Sends the page the tabs that go with the active step; it opens them (``static/docks.js``)."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html("")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the active step."""
        if changed(old, new, "view.step"):
            step = new.view.step
            tabs = ",".join(TABS[step])
            self._html.content = f'<i hidden data-step="{step}" data-step-tabs="{tabs}"></i>'


class Docks:
    """Builds what a browser looks at, once it does, and draws snapshots into it.

    The fields of a step are built when the step is opened, and follow the session while it is open;
    what a tab shows is built when the tab is, and follows from then on.
    """

    def __init__(self, gui: Any, context: PanelContext, boundary: ErrorBoundary) -> None:
        self._gui, self._context, self._boundary = gui, context, boundary
        gui.set_panel_label("Procedure")
        left = gui.main_panel
        left.dock_left()
        left.set_width(LEFT_PX)
        sheet = (static_dir() / "docks.css").read_text("utf-8")
        gui.add_html(f"<style>{sheet}</style>")
        step_list = StepList(gui, context)
        panels: list[Drawable] = [step_list, StepTitle(gui, context), TabsOfStep(gui)]
        self._steps: dict[str, StepPanel] = {}
        self._drawn: dict[str, Snapshot] = {}  # what their fields show, of the hidden ones as well
        run_bar = RunBar(
            gui, context, self._steps, STEP_PANELS
        )  # above the fields: it never scrolls away
        self._drawing_errors = DrawingErrors(gui, boundary)
        panels += [Refused(gui), run_bar]
        buttons = {**step_list.buttons, **run_bar.buttons}
        panels.append(PageLink(gui, context, buttons, TAB_PANELS))
        self._tabs = self._right()
        self._in_tabs: dict[str, Drawable] = {}
        replay = gui.add_panel(visible=False)
        with replay.add_tab("Replay", "player-play"):
            panels.append(ReplayPanel(gui, context, replay))
        replay.float(x=16, y=-16, width=REPLAY_PX)
        replay.minimize()  # it would hide the lower part of the region
        self._panels = tuple(panels)

    def _right(self) -> dict[str, Any]:
        """Add the docks on the right; return their tabs, empty, by name."""
        upper, lower = self._gui.add_panel(), self._gui.add_panel()
        tabs = {name: upper.add_tab(name, icon) for name, (icon, _) in UPPER_TABS.items()}
        tabs |= {name: lower.add_tab(name, icon) for name, (icon, _) in LOWER_TABS.items()}
        upper.dock_right()
        lower.dock_below(upper)
        upper.set_width(RIGHT_PX)
        return tabs

    def build(self, step: str, tabs: Iterable[str]) -> frozenset[str]:
        """Build the fields of a step and what tabs show; return the names of the new tabs."""
        if step not in self._steps:
            self._steps[step] = STEP_PANELS[step](self._gui, self._context)
        before = frozenset(self._in_tabs)
        for name in tabs:
            if name not in self._in_tabs:
                with self._tabs[name]:
                    self._in_tabs[name] = TAB_PANELS[name](self._gui, self._context)
        return frozenset(self._in_tabs) - before

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Bring what is looked at from ``old`` to ``new``."""
        view = new.view
        fresh = self.build(view.step, (*TABS[view.step], *view.open_tabs))
        for name, panel in self._steps.items():
            last = self._drawn.get(name)
            if (
                last is None
                or name in (view.step, last.view.step)
                or last.session.id != new.session.id
            ):
                self._boundary.draw(panel, last, new)
                self._drawn[name] = new
        for name, tab in self._in_tabs.items():
            self._boundary.draw(tab, None if name in fresh else old, new)
        for panel in self._panels:
            self._boundary.draw(panel, old, new)
        self._drawing_errors.render(old, new)
