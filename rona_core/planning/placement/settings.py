"""What is asked of a placement, and how well its bed will be milled."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.limits import require, require_within
from rona_core.geometry.arrays import Floats, readonly


@dataclass(frozen=True, slots=True)
class PlacementLimits:
    """What makes a placement safe."""

    residual_mm: float = 1.0  # of bone left below the bed everywhere: a stated choice, no standard
    probability: float = 0.99  # of that, and of enough bone for each screw

    def __post_init__(self) -> None:
        require_within("residual_mm", self.residual_mm, 0.0, 10.0)
        require_within("probability", self.probability, 0.5, 0.9999)


@dataclass(frozen=True, slots=True)
class ExecutionError:
    """Standard deviations of a milled bed against its plan, by the robot that made the maps."""

    depth_mm: float  # along the axis of the bed
    lateral_mm: float  # along each of the two directions across it

    def __post_init__(self) -> None:
        require_within("depth_mm", self.depth_mm, 0.0, 5.0)
        require_within("lateral_mm", self.lateral_mm, 0.0, 5.0)


@dataclass(frozen=True, slots=True)
class SearchGrid:
    """Placements that a search looks at, at every cell of the map."""

    angle_step_deg: float = 15.0  # in the plane of the map
    tilts_deg: tuple[float, ...] = (-3.0, 0.0, 3.0)  # about x and about y of the bed, all pairs

    def __post_init__(self) -> None:
        require_within("angle_step_deg", self.angle_step_deg, 1.0, 180.0)
        require(0.0 in self.tilts_deg, f"tilts_deg must have 0 among them, not {self.tilts_deg}")
        for tilt_deg in self.tilts_deg:
            require_within("tilts_deg", tilt_deg, -15.0, 15.0)

    def angles_rad(self, turn_rad: float) -> Floats:
        """Return the angles (n,) of a bed that looks the same after each turn by ``turn_rad``."""
        count = max(1, int(np.ceil(turn_rad / np.deg2rad(self.angle_step_deg) - 1e-9)))
        return readonly(turn_rad * np.arange(count) / count)

    def tilt_pairs_rad(self) -> Floats:
        """Return the tilts (n, 2) about x and y of the bed."""
        tilts = np.deg2rad(self.tilts_deg)
        return readonly(np.array([(about_x, about_y) for about_x in tilts for about_y in tilts]))
