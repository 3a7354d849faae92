"""Step 3: the pointer pivots about its tip; the tip is calibrated."""

from typing import Any

from rona_core.app.steps.pointer.messages import CalibratePointer, StartPointerCapture
from rona_core.app.steps.tool.calibration_view import calibration_view
from rona_ui.panels.tool.tool import CalibrationWords
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.capture_controls import ImportControls
from rona_ui.panels.widgets.form import on_click
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.snapshot import Snapshot, changed

HELP = (
    "Drag the coloured handles to pivot the pointer. Tilt it in two directions, then finish. "
    "The capture ends by itself after the set duration."
)


class PointerPanel(StepPanel):
    """Parameters of the pivoting, and the method of the fit."""

    step = "pointer"
    activity = "StartPointerCapture"
    explanation = (
        "The pointer tip rests in a dimple while the pointer pivots over a cone. A wider "
        "cone determines the tip better."
    )
    start = "Pivot and calibrate"

    def build_result(self) -> None:
        """Add what the calibration is worth."""
        self._calibration = CalibrationWords(self.gui, "pointer")

    def build(self) -> None:
        """Add cone, duration and method."""
        self.form.of(StartPointerCapture, "cone_deg", "duration_s")
        self.form.of(CalibratePointer, "method")
        self._by_hand = self.context.send_button(
            self.gui,
            "Pivot by hand",
            "hand-grab",
            lambda: StartPointerCapture(**self.form.values("duration_s"), by_hand=True),
        )
        self._help = self.gui.add_html("")
        self._finish = self.gui.add_button("Finish and calibrate", icon="check", visible=False)
        on_click(self._finish, lambda e: self.context.service("finish", e, None))
        self._refit = self.context.send_button(
            self.gui,
            "Fit again",
            "refresh",
            lambda: CalibratePointer(**self.form.values("method"), exclude=self._excluded),
        )
        self._excluded: tuple[int, ...] = ()
        self._import = ImportControls(self.gui, self.context, "pivot")

    def message(self) -> Any:
        """Return the capture with these parameters."""
        return StartPointerCapture(**self.form.values("cone_deg", "duration_s"))

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Offer to pivot by hand, to finish that, and another fit once there is a recording."""
        self._by_hand.visible = not new.busy
        self._finish.visible = new.pivoting_by_hand
        self._help.content = style.note(HELP) if new.pivoting_by_hand else ""
        self._calibration.render(old, new)
        if changed(old, new, "session.results.pointer"):
            view = calibration_view(new.session, "pointer")
            self._excluded = () if view is None else view.excluded
        self._import.render(new)
        self._refit.visible = new.session.captures.pointer is not None
        self._refit.disabled = new.busy

    def remarks(self, snapshot: Snapshot) -> str:
        """Say what was found."""
        derived = snapshot.session.results.pointer
        if derived is None:
            return ""
        found = derived.value
        x, y, z = found.tip_pointermarker
        return style.text(
            f"Tip at ({x:.2f}, {y:.2f}, {z:.2f}) mm in the pointer marker ({found.dof}D), from a "
            f"cone of {found.cone_deg:.0f} deg."
        )
