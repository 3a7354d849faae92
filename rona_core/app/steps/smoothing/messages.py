"""Messages of the path simplification.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.devices.settings import (
    STRICT,
    require_within,
)


@dataclass(frozen=True, slots=True)
class SmoothScanPath:
    """Remove path points within a bound, and give each kept one its surface normal."""

    __pydantic_config__: ClassVar = STRICT
    tolerance_mm: float = 1.0
    metric: Literal["k1", "k2", "k3"] = "k1"
    method: Literal["greedy", "optimal", "fast", "rdp"] = "optimal"
    filter_s: float = 0.05  # sigma of the zero-phase filter before; 0 switches it off
    normal_radius_mm: float | None = None  # None: noise, density and curvature decide
    normal_method: Literal["jet", "ols"] = "jet"
    normal_step_mm: float = 3.0  # between normals along the path; 0: at the kept points alone

    def __post_init__(self) -> None:
        require_within("tolerance_mm", self.tolerance_mm, 0.01, 20.0)
        require_within("filter_s", self.filter_s, 0.0, 1.0)
        if self.normal_radius_mm is not None:
            require_within("normal_radius_mm", self.normal_radius_mm, 2.0, 40.0)
        require_within("normal_step_mm", self.normal_step_mm, 0.0, 50.0)
