"""Step 4: the pointer slides over the skull; the surface cloud is built."""

from typing import Any

from rona_core.app.messages import BuildSurface, ClearSurface, StartSurfaceCapture
from rona_ui.panels import style
from rona_ui.panels.door import listen
from rona_ui.panels.drawing import DrawingControls
from rona_ui.panels.importing import ImportControls
from rona_ui.panels.step_panel import StepPanel
from rona_ui.view_state import Picture


class SurfacePanel(StepPanel):
    """Sweep the region, or add strokes by hand."""

    step = "surface"
    explanation = (
        "The pointer slides over the bone in dense strokes, in the region and somewhat beyond. "
        "Drawn lines add strokes where points are missing."
    )
    start = "Sweep the region"

    def build(self) -> None:
        """Add duration, averaging, drawing."""
        self.form.number("duration_s", "Duration (s)", 60.0, 1.0, 600.0, 5.0)
        self.form.number(
            "average_s", "Averaging (s)", 0.1, 0.0, 2.0, 0.05, "Moving average along a stroke"
        )
        self._drawing = DrawingControls(self.gui, self.door, "surface", self._stroke)
        self._rebuild = self.gui.add_button("Build the cloud again", icon="refresh", color="gray")
        self._clear = self.gui.add_button("Forget the strokes", icon="trash", color="gray")
        listen(
            self._rebuild,
            lambda e: self.door.send(lambda: BuildSurface(**self.form.values("average_s")), e),
        )
        listen(self._clear, lambda e: self.door.send(ClearSurface, e))
        self._import = ImportControls(self.gui, self.door, "surface")

    def _stroke(self, picks: tuple[Any, ...]) -> Any:
        duration_s = max(3.0, 0.5 * len(picks))
        return StartSurfaceCapture(duration_s=duration_s, picks_base_mm=picks, append=True)

    def message(self) -> Any:
        """Return the sweep."""
        return StartSurfaceCapture(**self.form.values("duration_s"))

    def update(self, old: Picture | None, new: Picture) -> None:
        """Follow drawing and recordings."""
        self._drawing.render(new)
        self._import.render(new)
        there = bool(new.session.captures.surface)
        self._rebuild.visible = self._clear.visible = there and new.view.drawing is None
        self._rebuild.disabled = self._clear.disabled = new.busy

    def remarks(self, picture: Picture) -> str:
        """Say how many points there are."""
        derived, strokes = picture.session.results.surface, picture.session.captures.surface
        if derived is None:
            return ""
        cloud = derived.value
        return style.note(
            f"{len(cloud.points_base)} points from {len(strokes)} recording"
            f"{'' if len(strokes) == 1 else 's'}; {cloud.n_dropped} dropped as lift-offs.",
            "good",
        )
