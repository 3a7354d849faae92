"""Messages of the path simplification."""

from typing import Literal

from rona_core.app.messages.message import message
from rona_core.devices.limits import choice, number


@message
class SmoothScanPath:
    """Remove path points within a bound, and give each kept one its surface normal."""

    tolerance_mm: float = number(
        1.0, "Tolerance", "mm", 0.1, 5.0, 0.05, hint="Largest deviation from the demonstrated path"
    )
    metric: Literal["k1", "k2", "k3"] = choice(
        "k1",
        "Error metric",
        {"k1": "Max. deviation (Hausdorff)", "k2": "RMS deviation", "k3": "Area"},
        "With the metric Area the tolerance is in mm²",
    )
    method: Literal["greedy", "optimal", "fast", "rdp"] = choice(
        "optimal",
        "Method",
        {
            "optimal": "Fewest points",
            "fast": "Few points, fast",
            "greedy": "Greedy (paper)",
            "rdp": "Douglas-Peucker",
        },
        "Of the simplification; the first one is recommended",
    )
    filter_s: float = number(
        0.05, "Filter σ", "s", 0.0, 1.0, 0.01, hint="Of the zero-phase filter; 0: no filter"
    )
    normal_radius_mm: float | None = number(
        None, "Normal radius", "mm", 2.0, 40.0, 1.0, none="chosen from the point cloud"
    )
    normal_method: Literal["jet", "plane"] = choice(
        "jet",
        "Normal estimation",
        {"jet": "Quadric", "plane": "Plane (paper)"},
        "Surface that is fitted to the points around a path point",
    )
    normal_step_mm: float = number(
        3.0, "Normal spacing", "mm", 0.0, 50.0, 0.5, hint="Along the path; 0: at its points only"
    )
