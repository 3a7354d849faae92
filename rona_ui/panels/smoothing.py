"""Step 6: fewer path points within a bound, and a surface normal for each."""

from typing import Any

from rona_core.app.messages import SmoothScanPath
from rona_ui.panels import style
from rona_ui.panels.step_panel import StepPanel
from rona_ui.scene.colors import BLUE, ORANGE, YELLOW, css
from rona_ui.view_state import Picture

METRICS = {"K1: largest distance": "k1", "K2: RMS distance": "k2", "K3: area": "k3"}
METHODS = {
    "Fewest points": "optimal",
    "Greedy (as the paper)": "greedy",
    "Few points, fast": "fast",
    "Douglas-Peucker": "rdp",
}
NORMALS = {
    "Quadric": "jet",
    "Total least squares": "tls",
    "Least squares (as the paper)": "ols",
    "Robust plane": "robust",
}


class SmoothingPanel(StepPanel):
    """Bound, metric, method, filter and the radius of the normals."""

    step = "smoothing"
    explanation = (
        "Points are taken away as long as the path stays within the bound; each one kept gets "
        "the normal of the surface points round it."
    )
    start = "Smooth the path"

    def build(self) -> None:
        """Add the parameters."""
        self.form.number("tolerance_mm", "Bound (mm)", 1.0, 0.01, 20.0, 0.1)
        self.form.choice("metric", "Measure", METRICS, "k1")
        self.form.choice("method", "Method", METHODS, "optimal")
        self.form.number("filter_s", "Filter (s)", 0.05, 0.0, 1.0, 0.01, "Sigma; 0 for none")
        self.form.choice("normal_method", "Normals", NORMALS, "jet")
        self.form.number(
            "normal_radius_mm", "Normal radius (mm)", 0.0, 0.0, 40.0, 1.0, "0: the cloud decides"
        )
        self.form.number(
            "normal_step_mm", "Normal every (mm)", 3.0, 0.0, 50.0, 0.5, "0: at kept points alone"
        )

    def message(self) -> Any:
        """Return the smoothing with these parameters."""
        values = self.form.values()
        values["normal_radius_mm"] = values["normal_radius_mm"] or None
        return SmoothScanPath(**values)

    def remarks(self, picture: Picture) -> str:
        """Say what is left, and what the colours mean."""
        derived = picture.session.results.smoothing
        if derived is None:
            return ""
        kept = derived.value.simplified
        words = style.note(
            f"{kept.n_original} points became {len(kept.index)}; largest distance K1 "
            f"{kept.k1_mm:.2f} mm, K2 {kept.k2_mm:.2f} mm, K3 {kept.k3_mm2:.1f} mm².",
            "good",
        )
        legend = ((css(ORANGE), "demonstrated"), (css(BLUE), "smoothed"), (css(YELLOW), "axes"))
        return words + style.key(legend)
