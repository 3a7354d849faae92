"""Step 6: path simplification within a tolerance, edits by hand, surface normals."""

from typing import Any

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.steps.path.messages import ClearPathEdits
from rona_core.app.steps.path.path_checks import PathCheck, Stretch, check_path
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.smoothing.path_view import PathView
from rona_core.devices.limits import limits_of
from rona_core.session.document import Derived, SmoothPath
from rona_ui.panels.path.smoothed_path import PathPoints
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import on_change, on_click
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.colors import BLUE, PURPLE, STEEL, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot, changed, shown_path
from rona_ui.presentation.view_state import EDITS, Drawing, Preview

DEVIATION, DEVIATION_RAW = FIGURES["path_deviation_max_mm"], FIGURES["path_deviation_raw_max_mm"]

HELP = {
    "move": (
        "Drag a blue point over the skull, or click it and then its new position. The arrow keys "
        "move the selected one by 0.5 mm, with Shift by 0.1 mm."
    ),
    "insert": "Click the skull to insert a point into the nearest segment.",
    "delete": "Click a blue point to delete it.",
    "pin": (
        "Click the demonstrated path to pin a point: the path passes through it. Click again "
        "to release it."
    ),
}
ADVANCED = (
    "method",
    "metric",
    "filter_s",
    "normal_method",
    "normal_radius_mm",
    "normal_step_mm",
)
MAX_LISTED, MAX_PLACES = 4, 8


class SmoothingPanel(StepPanel):
    """Tolerance slider, edits by hand, and advanced parameters in a folder."""

    step = "smoothing"
    explanation = (
        "Simplifies the path: removes points while the path stays within the tolerance. Each "
        "remaining point gets the normal of the surface points around it."
    )
    start = "Smooth the path"

    def build(self) -> None:
        """Add the parameters."""
        form, gui = self.form, self.gui
        self._seen: Snapshot | None = None
        tolerance = form.slider(SmoothScanPath, "tolerance_mm")
        on_change(tolerance, self._drag)
        with gui.add_folder("Advanced", expand_by_default=False):
            form.of(SmoothScanPath, *ADVANCED)
        self._edit = gui.add_button_group("Edit", tuple(EDITS))
        self._help = gui.add_html("")
        self._done = gui.add_button("Done", icon="check", visible=False)
        on_click(self._done, lambda e: self._mode(None))
        self._discard = self.context.send_button(gui, "Discard edits", "trash", ClearPathEdits)
        self._points = PathPoints(gui, self.context)
        on_click(self._edit, lambda e: self._mode(EDITS[self._edit.value]))

    def _mode(self, mode: Drawing | None) -> None:
        self.context.set_view(drawing=mode, picks=(), moved_point=None, move_target=None)

    def _drag(self, event: Any) -> None:
        """Preview while the slider is dragged; once it rests, compute."""
        seen, value = self._seen, float(self.form.value("tolerance_mm"))
        if seen is None or seen.session.results.path is None or seen.busy:
            return
        preview = Preview(value, seen.session.results.smoothing, seen.refused)
        self.context.set_view(preview=preview)
        if seen.session.results.surface is not None:
            self.context.send_debounced("tolerance", self.message, event)

    def message(self) -> Any:
        """Return the smoothing with these parameters."""
        return SmoothScanPath(**self.form.values())

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the result, and what is being changed by hand."""
        self._seen = new
        smooth = new.session.results.smoothing
        if smooth is not None and changed(old, new, "session.results.smoothing"):
            self.form.show(smooth.arguments)
        mode = new.view.drawing
        self._help.content = style.note(f"{HELP[mode]} Undo with Ctrl+Z.") if mode in HELP else ""
        fresh = smooth is not None and new.step("smoothing").state != "stale"
        self._edit.visible = fresh and not new.busy  # a group cannot be disabled
        self._done.visible = mode in HELP
        self._discard.visible = len(new.session.path_edits) > 0
        self._discard.disabled = new.busy
        self._points.render(old, new)

    def remarks(self, snapshot: Snapshot) -> str:
        """Return counts, deviations, normal uncertainty and warnings."""
        view = shown_path(snapshot)
        words = "" if view is None else counts(view)
        check = check_path(snapshot.session)
        smooth = snapshot.session.results.smoothing
        if check is None or smooth is None or snapshot.preview_mm is not None:
            return words
        normals = smooth.value.normals
        chosen = "given" if normals.choice is None else "from the point cloud"
        if normals.choice is not None:
            chosen += f": noise {normals.choice.noise_mm:.2f} mm"
        words += _replaced_method(smooth) + style.text(
            f"Normal radius {normals.radius_mm:.1f} mm ({chosen})."
        )
        return words + warning_notes(check) + style.key(LEGEND)


def _replaced_method(smooth: Derived[SmoothPath]) -> str:
    """Return which method was used in place of the chosen one; nothing where that was used."""
    used = smooth.value.simplified
    if used.method == smooth.arguments.get("method", used.method):
        return ""
    title = limits_of(SmoothScanPath)["method"]["labels"][used.method]
    return style.note(f"Method used: {title}. Points that stay: {used.rule}.")


LEGEND = (
    (css(BLUE), "smoothed"),
    (css(STEEL), "probe axis"),
    (css(VERMILLION), "tilt too large"),
    (css(PURPLE), "sample again"),
)


def counts(view: PathView) -> str:
    """Return how many points are left, the least there could be, and the deviations."""
    count = len(view.corners_base)
    if view.preview:
        return style.note(
            f"{view.tolerance_mm:.2f} mm: about {count} of {len(view.raw_base)} points. "
            "Release for the minimum."
        )
    least = "minimum" if view.exact else "fewer may suffice"
    by_hand = f" {view.by_hand} edited by hand." if view.by_hand else ""
    return style.note(
        f"{len(view.raw_base)} points simplified to {count} ({least}).{by_hand} "
        f"{DEVIATION.named(view.k1_filtered_mm)}. {DEVIATION_RAW.named(view.k1_raw_mm)}.",
        "good",
    )


def warning_notes(check: PathCheck) -> str:
    """Return the warnings, then where the pointer should pass once more."""
    words = ""
    if check.warnings:
        lines = [f"{_at((s,))}: {s.sentence}." for s in check.warnings[:MAX_LISTED]]
        more = len(check.warnings) - MAX_LISTED
        lines += [f"And {more} more."] if more > 0 else []
        title = f"Probe tilt may exceed {check.tolerance_deg:.1f}°."
        words += style.note(f"{title} {' '.join(lines)}", "warn")
    for reason in dict.fromkeys(s.sentence for s in check.proposals):
        held = tuple(s for s in check.proposals if s.sentence == reason)
        times = max(s.times for s in held)
        words += style.note(
            f"Sample the surface again at {_at(held)}: {reason} (up to {times:.0f} times as "
            "many points)."
        )
    return words or style.note(
        f"Probe tilt within the tolerance of {check.tolerance_deg:.1f}°.", "good"
    )


def _at(stretches: tuple[Stretch, ...]) -> str:
    """Return places along the path, in mm from its start."""
    shown = [
        f"{s.from_mm:.0f}" if s.to_mm - s.from_mm < 1.0 else f"{s.from_mm:.0f} to {s.to_mm:.0f}"
        for s in stretches[:MAX_PLACES]
    ]
    more = len(stretches) - MAX_PLACES
    return f"{', '.join(shown)} mm" + (f" and {more} more places" if more > 0 else "")
