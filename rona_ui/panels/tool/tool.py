"""Step 2: the robot pivots and translates the tool; tip and tracker are registered."""

from typing import Any

from rona_core.app.steps.tool.messages import StartToolCapture
from rona_ui.panels.tool.calibration import CalibrationControls
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.snapshot import Snapshot


class ToolPanel(StepPanel):
    """Parameters of the tool motion and what came of it."""

    step = "tool"
    activity = "StartToolCapture"
    explanation = (
        "The robot pivots the tool about its tip and translates it along x and y while the "
        "tracker records the tool marker."
    )
    start = "Move and register the tool"

    def build(self) -> None:
        """Add the parameters of the motion."""
        self.form.number("cone_deg", "Pivot cone (deg)", 20.0, 5.0, 45.0, 1.0, "Half-angle")
        self.form.number("n_pivot", "Pivot poses", 30, 5, 200, 1)
        self.form.number("n_translate", "Poses per axis", 10, 3, 60, 1)
        self._calibration = CalibrationControls(self.gui, self.context, "tool")

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Show the motion and its poses."""
        self._calibration.render(old, new)

    def message(self) -> Any:
        """Return the capture with these parameters."""
        return StartToolCapture(**self.form.values())

    def remarks(self, snapshot: Snapshot) -> str:
        """Say what was found."""
        derived = snapshot.session.results.tool
        if derived is None:
            return ""
        x, y, z = derived.value.T_toolmarker_tip.translation
        return style.text(f"Tip at ({x:.2f}, {y:.2f}, {z:.2f}) mm in the tool marker.")
