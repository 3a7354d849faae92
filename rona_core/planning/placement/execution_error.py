"""How well the robot that made the maps mills a bed in the posture of the scan."""

import numpy as np

from rona_core.mapping.accuracy.probe_place import SEAT_MM, repeatability_mm
from rona_core.planning.placement.settings import ExecutionError


def execution_error(robot: str, tip_sigma_mm: float | None) -> ExecutionError:
    """Return what a bed is off by: the tip of the burr, and what the robot does not repeat.

    Args:
        robot: Its model.
        tip_sigma_mm: 3D standard deviation of the registered tip, as which it counts as known.
            None: without a registration the spindle is clamped by hand, as the probe is, and may
            be off as far as that.
    """
    along_mm = SEAT_MM if tip_sigma_mm is None else tip_sigma_mm / np.sqrt(3.0)
    sigma_mm = float(np.hypot(along_mm, repeatability_mm(robot)))
    return ExecutionError(depth_mm=sigma_mm, lateral_mm=sigma_mm)
