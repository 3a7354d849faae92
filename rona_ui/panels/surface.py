"""Step 4: the pointer slides over the skull; the surface cloud is built."""

from typing import Any

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.overview.predicted_accuracy import predict_skull_mm, predict_surface
from rona_core.app.steps.surface.messages import (
    BuildSurface,
    ClearSurface,
    StartSkullRegistration,
    StartSurfaceCapture,
)
from rona_core.session.document import Session
from rona_core.session.specimen import LoadedSkull
from rona_ui.panels.tool.calibration import VERDICTS
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.draw_on_skull import DrawingControls
from rona_ui.panels.widgets.import_recording import ImportControls
from rona_ui.panels.widgets.panel_context import listen
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.view_state import Picture
from rona_ui.viewer.bindings import escape


class SurfacePanel(StepPanel):
    """Sweep the region, or add strokes by hand."""

    step = "surface"
    activity = "StartSurfaceCapture"
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
        self._register = self.gui.add_button(
            "Register the loaded skull", icon="puzzle", color="gray", visible=False
        )
        self._registered = self.gui.add_html("")
        listen(self._register, lambda e: self.door.send(StartSkullRegistration, e))
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
        self._rebuild.disabled = self._clear.disabled = self._register.disabled = new.busy
        loaded = isinstance(new.session.setup.specimen, LoadedSkull)
        done = new.session.results.surface is not None
        self._register.visible = loaded and done and new.view.drawing is None
        if old is None or old.session is not new.session:
            words = registered(new.session)
            if self._registered.content != words:
                self._registered.content = words

    def remarks(self, picture: Picture) -> str:
        """Say how many points there are."""
        derived, strokes = picture.session.results.surface, picture.session.captures.surface
        if derived is None:
            return ""
        cloud = derived.value
        expected = predict_surface(picture.session)
        words = ""
        if expected is not None and expected.normal_mm is not None:
            words = (
                f" They are expected to be off the bone by {expected.normal_mm:.2f} mm (RMS), "
                f"{expected.rms_mm:.2f} mm in all directions: {expected.registration_mm:.2f} by "
                f"robot and tracker, {expected.pointer_mm:.2f} by the pointer tip, "
                f"{expected.frame_mm:.2f} by {expected.frames} averaged frames, "
                f"{expected.stated_mm:.2f} by the tracker's volume as its maker states it."
            )
        return style.note(
            f"{len(cloud.points_base)} points from {len(strokes)} recording"
            f"{'' if len(strokes) == 1 else 's'}; {cloud.n_dropped} dropped as lift-offs.{words}",
            "good",
        )


def registered(session: Session) -> str:
    """Return where the loaded skull lies, how well that is known, and what is weak."""
    derived = session.results.registration
    if derived is None:
        return ""
    found = derived.value
    x, y, z = found.T_b_a.inv().translation
    sigma_mm = predict_skull_mm(session)
    expected = ""
    if sigma_mm is not None:
        expected = f"It is expected to be off by {sigma_mm:.2f} mm at the points. "
    icon, word, color, box = VERDICTS[found.verdict]
    reasons = "".join(f"<br>{escape(reason[0].upper() + reason[1:])}." for reason in found.reasons)
    stale = stale_reason("registration", session)
    if stale is not None:
        reasons += f"<br>! Stale: {escape(stale)}."
        box = "warn"
    return (
        f'<div class="r-note {box}">Loaded skull: <b style="color:{color}">{icon} {word}</b>. '
        f"The origin of its file lies at ({x:.1f}, {y:.1f}, {z:.1f}) mm in the base. {expected}"
        f"The fit alone leaves {found.sigmas_mm[0]:.2f} mm in its weakest direction; points lie "
        f"{found.rms_mm:.2f} mm (RMS) off, {int(found.used.sum())} of {len(found.used)} used, "
        f"normals over {found.normals_deg:.0f}°.{reasons}</div>"
    )
