"""Step 2: the robot pivots and translates the tool; tip and tracker are registered."""

from typing import Any

from rona_core.app.messages import StartToolCapture
from rona_ui.panels import style
from rona_ui.panels.step_panel import StepPanel
from rona_ui.view_state import Picture


class ToolPanel(StepPanel):
    """Parameters of the tool motion and what came of it."""

    step = "tool"
    explanation = (
        "The robot pivots the tool about its tip and moves it along its x and y axes while the "
        "tracker watches the marker plate."
    )
    start = "Move and register the tool"

    def build(self) -> None:
        """Add the parameters of the motion."""
        self.form.number("cone_deg", "Pivot cone (deg)", 20.0, 5.0, 45.0, 1.0, "Half-angle")
        self.form.number("n_pivot", "Pivot poses", 30, 5, 200, 1)
        self.form.number("n_translate", "Poses per axis", 10, 3, 60, 1)

    def message(self) -> Any:
        """Return the capture with these parameters."""
        return StartToolCapture(**self.form.values())

    def remarks(self, picture: Picture) -> str:
        """Say how well the registration fits."""
        derived = picture.session.results.tool
        if derived is None:
            return ""
        tool = derived.value
        x, y, z = tool.T_toolmarker_tip.translation
        n_used = int(tool.used.sum())
        found = (
            f"Tip at ({x:.2f}, {y:.2f}, {z:.2f}) mm in the tool marker; random error expected "
            f"{tool.tip_sigma_mm:.2f} mm, of the tracker's place near it "
            f"{tool.registration_sigma_mm:.2f} mm. {n_used} of {tool.n_poses} poses used. "
        )
        reasons = " ".join(f"{reason[0].upper()}{reason[1:]}." for reason in tool.reasons)
        return style.note(found + reasons, "good" if tool.verdict == "good" else "warn")
