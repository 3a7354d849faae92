"""Step 6: fewer path points within a bound, changes by hand, and a surface normal for each."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.path.messages import ClearPathEdits
from rona_core.app.steps.path.path_checks import PathCheck, Stretch, check_path
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.smoothing.path_view import PathView
from rona_ui.panels.path.path_graph import bar
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import follow, listen
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.scene.colors import BLUE, PURPLE, VERMILLION, css
from rona_ui.scene.path.path import shown_path
from rona_ui.view_state import Drawing, Picture, Preview

METRICS = {"K1: largest distance": "k1", "K2: RMS distance": "k2", "K3: area": "k3"}
METHODS = {
    "Fewest points": "optimal",
    "Few points, fast": "fast",
    "Greedy (as the paper)": "greedy",
    "Douglas-Peucker": "rdp",
}
NORMALS = {
    "Quadric": "jet",
    "Total least squares": "tls",
    "Least squares (as the paper)": "ols",
    "Robust plane": "robust",
}
EDITS: dict[str, Drawing] = {"Move": "move", "Insert": "insert", "Delete": "delete", "Keep": "keep"}
HELP = {
    "move": "Drag a blue point over the skull, or click it and then its new place.",
    "insert": "Click the skull where the path shall pass; the point joins the nearest piece.",
    "delete": "Click a blue point to take it away.",
    "keep": "Click the demonstrated path where it must not be left. Click again: it may.",
}
MOST_TOLD, MOST_PLACES = 4, 8


class SmoothingPanel(StepPanel):
    """The bound as a slider, changes by hand, and what is rarely changed in a folder."""

    step = "smoothing"
    explanation = (
        "Points are taken away as long as the path stays within the bound; each one kept gets "
        "the normal of the surface points round it."
    )
    start = "Smooth the path"

    def build(self) -> None:
        """Add the parameters."""
        form, gui = self.form, self.gui
        self._seen: Picture | None = None
        bound = form.slider("tolerance_mm", "Bound (mm)", 1.0, 0.1, 5.0, 0.05)
        follow(bound, self._drag)
        with gui.add_folder("Advanced", expand_by_default=False):
            form.choice("method", "Method", METHODS, "optimal")
            form.choice("metric", "Measure", METRICS, "k1", "K3 reads the bound in mm²")
            form.number("filter_s", "Filter (s)", 0.05, 0.0, 1.0, 0.01, "Sigma; 0 for none")
            form.choice("normal_method", "Normals", NORMALS, "jet")
            form.number(
                "normal_radius_mm", "Radius (mm)", 0.0, 0.0, 40.0, 1.0, "0: the cloud decides"
            )
            form.number(
                "normal_step_mm", "Normal every", 3.0, 0.0, 50.0, 0.5, "mm; 0: kept points alone"
            )
        self._edit = gui.add_button_group("By hand", tuple(EDITS))
        self._help = gui.add_html("")
        self._done = gui.add_button("Done", icon="check", visible=False)
        self._forget = gui.add_button("Forget the changes", icon="trash", color="gray")
        listen(self._edit, lambda e: self._mode(EDITS[self._edit.value]))
        listen(self._done, lambda e: self._mode(None))
        listen(self._forget, lambda e: self.door.send(ClearPathEdits, e))

    def _mode(self, mode: Drawing | None) -> None:
        self.door.view(lambda v: replace(v, drawing=mode, picks=(), grabbed=None, ghost=None))

    def _drag(self, event: Any) -> None:
        """Preview while the slider is dragged; once it rests, compute."""
        seen, value = self._seen, float(self.form.values("tolerance_mm")["tolerance_mm"])
        if seen is None or seen.session.results.path is None or seen.busy:
            return
        preview = Preview(value, seen.session.results.smoothing, seen.refused)
        self.door.view(lambda v: replace(v, preview=preview))
        if seen.session.results.surface is not None:
            self.door.send_settled("tolerance", self.message, event)

    def message(self) -> Any:
        """Return the smoothing with these parameters."""
        values = self.form.values()
        values["normal_radius_mm"] = values["normal_radius_mm"] or None
        return SmoothScanPath(**values)

    def update(self, old: Picture | None, new: Picture) -> None:
        """Follow the result, and what is being changed by hand."""
        self._seen = new
        smooth = new.session.results.smoothing
        if smooth is not None and (old is None or old.session.results.smoothing is not smooth):
            held = {**smooth.arguments}
            held["normal_radius_mm"] = held.get("normal_radius_mm") or 0.0
            self.form.show(held)
        mode = new.view.drawing
        words = style.note(f"{HELP[mode]} Ctrl+Z takes it back.") if mode in HELP else ""
        if self._help.content != words:
            self._help.content = words
        fresh = smooth is not None and new.step("smoothing").state != "stale"
        self._edit.visible = fresh and not new.busy  # a group cannot be disabled
        self._done.visible = mode in HELP
        self._forget.visible = len(new.session.path_edits) > 0
        self._forget.disabled = new.busy

    def remarks(self, picture: Picture) -> str:
        """Say what is left and how far off, what the normals are worth, and what to beware of."""
        view = shown_path(picture)
        words = "" if view is None else counts(view)
        check = check_path(picture.session)
        smooth = picture.session.results.smoothing
        if check is None or smooth is None or picture.preview_mm is not None:
            return words
        normals = smooth.value.normals
        chosen = "given" if normals.choice is None else "chosen by the cloud"
        if normals.choice is not None:
            chosen += f": noise {normals.choice.noise_mm:.2f} mm"
        words += style.text(f"Normals over a radius of {normals.radius_mm:.1f} mm ({chosen}).")
        words += bar("Uncertainty of the normals (deg)", check.tolerance_deg, "≥ ")
        return words + told(check) + style.key(LEGEND)


LEGEND = (
    (css(BLUE), "smoothed"),
    (css(VERMILLION), "may lean too far"),
    (css(PURPLE), "sample again"),
)


def counts(view: PathView) -> str:
    """Return how many points are left, the least there could be, and the deviations."""
    count = len(view.corners_base)
    if view.preview:
        return style.note(
            f"{view.tolerance_mm:.2f} mm: about {count} of {len(view.raw_base)} points. "
            "Let go for the fewest."
        )
    least = "the fewest possible" if view.exact else f"at least {view.lower_bound} are needed"
    by_hand = f" {view.by_hand} by hand." if view.by_hand else ""
    return style.note(
        f"{len(view.raw_base)} points became {count} ({least}).{by_hand} Largest distance "
        f"{view.k1_filtered_mm:.2f} mm from the filtered samples, {view.k1_raw_mm:.2f} mm from "
        "the raw ones.",
        "good",
    )


def told(check: PathCheck) -> str:
    """Return the warnings, then where the pointer should pass once more."""
    words = ""
    if check.warnings:
        lines = [f"{_at((s,))}: {s.sentence}." for s in check.warnings[:MOST_TOLD]]
        more = len(check.warnings) - MOST_TOLD
        lines += [f"And {more} more."] if more > 0 else []
        title = f"The probe may lean beyond {check.tolerance_deg:.1f}°."
        words += style.note(f"{title} {' '.join(lines)}", "warn")
    for reason in dict.fromkeys(s.sentence for s in check.proposals):
        held = tuple(s for s in check.proposals if s.sentence == reason)
        times = max(s.times for s in held)
        words += style.note(
            f"Pass with the pointer once more at {_at(held)}: {reason} (up to {times:.0f} times as "
            "many points)."
        )
    return words or style.note(
        f"The probe stays within its tilt tolerance of {check.tolerance_deg:.1f}°.", "good"
    )


def _at(stretches: tuple[Stretch, ...]) -> str:
    """Return places along the path, in mm from its start."""
    shown = [
        f"{s.from_mm:.0f}" if s.to_mm - s.from_mm < 1.0 else f"{s.from_mm:.0f} to {s.to_mm:.0f}"
        for s in stretches[:MOST_PLACES]
    ]
    more = len(stretches) - MOST_PLACES
    return f"{', '.join(shown)} mm" + (f" and {more} more places" if more > 0 else "")
