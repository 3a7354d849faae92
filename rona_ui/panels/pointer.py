"""Step 3: the pointer pivots about its tip; the tip is calibrated."""

from typing import Any

from rona_core.app.steps.pointer.messages import CalibratePointer, StartPointerCapture
from rona_ui.panels.tool.calibration import CalibrationControls
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.import_recording import ImportControls
from rona_ui.panels.widgets.panel_context import listen
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.view_state import Picture

METHODS = {
    "Maximum likelihood": "ml",
    "Sphere (as the paper)": "sphere",
    "Algebraic one-step": "aos",
}


class PointerPanel(StepPanel):
    """Parameters of the pivoting, and the method of the fit."""

    step = "pointer"
    activity = "StartPointerCapture"
    explanation = (
        "The tip of the pointer rests in a dimple while the pointer is swung over a cone. "
        "The wider the cone, the better the tip is known."
    )
    start = "Pivot and calibrate"

    def build(self) -> None:
        """Add cone, duration and method."""
        self.form.number(
            "cone_deg", "Cone (deg)", StartPointerCapture().cone_deg, 1.0, 60.0, 1.0, "Half-angle"
        )
        self.form.number("duration_s", "Duration (s)", 15.0, 1.0, 120.0, 1.0)
        self.form.choice("method", "Fit", METHODS, "ml")
        self._by_hand = self.gui.add_button("Pivot by hand", icon="hand-grab", color="gray")
        self._help = self.gui.add_html("")
        self._finish = self.gui.add_button("Finish and calibrate", icon="check", visible=False)
        self._refit = self.gui.add_button("Fit again", icon="refresh", color="gray")
        listen(
            self._refit,
            lambda e: self.door.send(self._fit_again, e),
        )
        listen(self._by_hand, lambda e: self.door.send(self._capture_by_hand, e))
        listen(self._finish, lambda e: self.door.service("finish", e, None))
        self._calibration = CalibrationControls(self.gui, self.door, "pointer")
        self._import = ImportControls(self.gui, self.door, "pivot")

    def _fit_again(self) -> Any:
        """Return the fit by the chosen method, without the poses that are left out by hand."""
        excluded = self._calibration.excluded()
        return CalibratePointer(**self.form.values("method"), exclude=excluded)

    def _capture_by_hand(self) -> Any:
        return StartPointerCapture(**self.form.values("duration_s"), by_hand=True)

    def message(self) -> Any:
        """Return the capture with these parameters."""
        return StartPointerCapture(**self.form.values("cone_deg", "duration_s"))

    def update(self, old: Picture | None, new: Picture) -> None:
        """Offer to pivot by hand, to finish that, and another fit once there is a recording."""
        self._by_hand.visible = not new.busy
        self._finish.visible = new.turning
        words = ""
        if new.turning:
            words = style.note(
                "Drag the coloured arcs about the tip: the pointer turns with them. Tilt it in two "
                "directions, then finish; at the end of the time that happens by itself."
            )
        if self._help.content != words:
            self._help.content = words
        self._calibration.render(old, new)
        self._import.render(new)
        self._refit.visible = new.session.captures.pointer is not None
        self._refit.disabled = new.busy

    def remarks(self, picture: Picture) -> str:
        """Say what was found."""
        derived = picture.session.results.pointer
        if derived is None:
            return ""
        found = derived.value
        x, y, z = found.tip_pointermarker
        return style.text(
            f"Tip at ({x:.2f}, {y:.2f}, {z:.2f}) mm in the pointer marker ({found.dof}D), from a "
            f"cone of {found.cone_deg:.0f} deg."
        )
