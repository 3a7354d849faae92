"""Step 4: the pointer slides over the skull; the surface cloud is built."""

from typing import Any

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.overview.predicted_accuracy import predict_skull_mm, predict_surface
from rona_core.app.steps.surface.messages import (
    BuildSurface,
    ClearSurface,
    StartSkullRegistration,
    StartSurfaceCapture,
)
from rona_core.app.steps.surface.step import is_own_cloud
from rona_core.session.document import Session
from rona_core.session.specimen import LoadedSkull
from rona_ui.panels.tool.tool import VERDICTS
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.capture_controls import DrawingControls, ImportControls, Lifts, Picks
from rona_ui.panels.widgets.step_panel import LoadFolder, StepPanel
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import escape

PREDICTED = FIGURES["surface_sigma_predicted_mm"]
SKULL = FIGURES["skull_registration_sigma_mm"]


class SurfacePanel(StepPanel):
    """Sweep the region, or add strokes by hand."""

    step = "surface"
    activity = "StartSurfaceCapture"
    explanation = (
        "The pointer slides over the bone in dense strokes, in the region and slightly "
        "beyond. Draw strokes where points are missing."
    )
    start = "Sweep the region"

    def build(self) -> None:
        """Add duration, averaging, drawing."""
        self.form.of(StartSurfaceCapture, "duration_s")
        self.form.of(BuildSurface)
        self._drawing = DrawingControls(self.gui, self.context, "surface", self._strokes)
        self._rebuild = self.context.send_button(
            self.gui,
            "Rebuild point cloud",
            "refresh",
            lambda: BuildSurface(**self.form.values("average_s")),
        )
        self._clear = self.context.send_button(self.gui, "Delete strokes", "trash", ClearSurface)
        self._register = self.context.send_button(
            self.gui, "Register loaded skull", "puzzle", StartSkullRegistration, visible=False
        )
        self._registered = self.gui.add_html("")
        self._import = ImportControls(self.gui, self.context, "surface")
        self._load = LoadFolder(self.gui, self.context, "cloud")

    def _strokes(self, picks: Picks, lifts: Lifts) -> Any:
        duration_s = min(600.0, max(3.0 * (len(lifts) + 1), 0.5 * len(picks)))
        return StartSurfaceCapture(
            duration_s=duration_s, picks_base_mm=picks, append=True, lifts=lifts
        )

    def message(self) -> Any:
        """Return the sweep."""
        return StartSurfaceCapture(**self.form.values("duration_s"))

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow drawing and recordings."""
        self._drawing.render(new)
        self._import.render(new)
        self._load.render(new)
        there = bool(new.session.captures.surface)
        self._rebuild.visible = self._clear.visible = there and new.view.drawing is None
        self._rebuild.disabled = self._clear.disabled = self._register.disabled = new.busy
        loaded = isinstance(new.session.setup.specimen, LoadedSkull)
        done = new.session.results.surface is not None
        self._register.visible = loaded and done and new.view.drawing is None
        if changed(old, new, "session"):
            self._registered.content = registered(new.session)

    def remarks(self, snapshot: Snapshot) -> str:
        """Say how many points there are."""
        derived, strokes = snapshot.session.results.surface, snapshot.session.captures.surface
        if derived is None:
            return ""
        cloud = derived.value
        expected = predict_surface(snapshot.session)
        words = ""
        if expected is not None and expected.normal_mm is not None:
            words = (
                f"{PREDICTED.named(expected.normal_mm)} normal to the bone, "
                f"{expected.rms_mm:.2f} mm in 3D. Contributions: robot and tracker "
                f"{expected.registration_mm:.2f}, pointer tip {expected.pointer_mm:.2f}, "
                f"{expected.frames} averaged frames {expected.frame_mm:.2f}, tracker volume "
                f"(specification) {expected.tracker_mm:.2f}, robot (specification) "
                f"{expected.robot_mm:.2f} mm."
            )
        if is_own_cloud(snapshot.session):
            return style.note(f"{len(cloud.points_base)} points. {words}".rstrip(), "good")
        return style.note(
            f"{len(cloud.points_base)} points from {len(strokes)} "
            f"recording{'' if len(strokes) == 1 else 's'}; {cloud.n_dropped} rejected as "
            f"lift-offs. {words}".rstrip(),
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
        expected = f"{SKULL.named(sigma_mm)}. "
    icon, word, color, box = VERDICTS[found.verdict]
    reasons = "".join(f"<br>{escape(style.sentence(reason))}." for reason in found.reasons)
    stale = stale_reason("registration", session)
    if stale is not None:
        reasons += f"<br>! Stale: {escape(stale)}."
        box = "warn"
    return (
        f'<div class="r-note {box}">Loaded skull: <b style="color:{color}">{icon} {word}</b>. '
        f"File origin at ({x:.1f}, {y:.1f}, {z:.1f}) mm in the base. {expected}"
        f"Fit: σ {found.sigmas_mm[0]:.2f} mm in the weakest direction, residual "
        f"{found.rms_mm:.2f} mm RMS, {int(found.used.sum())} of {len(found.used)} "
        f"points used, normals spread over {found.normals_deg:.0f}°.{reasons}</div>"
    )
