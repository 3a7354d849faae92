"""Step 5: the pointer demonstrates the scan path, or a pattern is made by rule."""

from typing import Any

from rona_core.app.steps.path.messages import StartPathCapture
from rona_ui.panels.path.pattern import PatternControls
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.draw_on_skull import DrawingControls
from rona_ui.panels.widgets.import_recording import ImportControls
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.snapshot import Snapshot


class PathPanel(StepPanel):
    """A meander by the operator, a line drawn by mouse, or a pattern."""

    step = "path"
    activity = "StartPathCapture"
    explanation = (
        "The pointer demonstrates the scan path: a raster over the region, or a line you "
        "draw on the skull. Or generate a pattern on the measured surface."
    )
    start = "Record raster path"

    def build(self) -> None:
        """Add duration, spacing, drawing."""
        self.form.number("duration_s", "Duration (s)", 40.0, 1.0, 600.0, 5.0)
        self.form.number("spacing_mm", "Line spacing (mm)", 4.0, 1.0, 20.0, 0.5)
        self._drawing = DrawingControls(self.gui, self.context, "path", self._line)
        self._pattern = PatternControls(self.gui, self.context)
        self._import = ImportControls(self.gui, self.context, "path")

    def _line(self, picks: tuple[Any, ...]) -> Any:
        duration_s = max(5.0, 0.5 * len(picks))
        return StartPathCapture(duration_s=duration_s, picks_base_mm=picks)

    def message(self) -> Any:
        """Return the meander."""
        return StartPathCapture(**self.form.values())

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow drawing."""
        self._drawing.render(new)
        self._pattern.render(new)
        self._import.render(new)

    def remarks(self, snapshot: Snapshot) -> str:
        """Say how many points were demonstrated."""
        derived = snapshot.session.results.path
        if derived is None:
            return ""
        count = len(derived.value.points_base)
        if derived.message == "GenerateScanPattern":
            return style.note(f"Pattern of {count} points (orange line).", "good")
        return style.note(f"Demonstrated path of {count} points (orange line).", "good")
