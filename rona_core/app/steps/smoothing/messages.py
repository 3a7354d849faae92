"""Messages of the path simplification."""

from typing import Literal

from rona_core.app.messages.message import message, within


@message
class SmoothScanPath:
    """Remove path points within a bound, and give each kept one its surface normal."""

    tolerance_mm: float = within(0.01, 20.0, default=1.0)
    metric: Literal["k1", "k2", "k3"] = "k1"
    method: Literal["greedy", "optimal", "fast", "rdp"] = "optimal"
    # sigma of the zero-phase filter before; 0 switches it off
    filter_s: float = within(0.0, 1.0, default=0.05)
    # None: noise, density and curvature decide
    normal_radius_mm: float | None = within(2.0, 40.0, default=None)
    normal_method: Literal["jet", "ols"] = "jet"
    # between normals along the path; 0: at the kept points alone
    normal_step_mm: float = within(0.0, 50.0, default=3.0)
