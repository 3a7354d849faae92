"""Calibration of tools and pointers; registration of robot, tracker and skull."""

from rona_core.calibration.hand_eye.hand_eye import solve_hand_eye
from rona_core.calibration.hand_eye.tool_registration import register_tool
from rona_core.calibration.handheld.pointer import calibrate_pointer
from rona_core.calibration.pivot.motion_extent import fit_sphere
from rona_core.calibration.pivot.pivot_calibration import solve_pivot
from rona_core.calibration.surface_registration import register_surface
from rona_core.calibration.timing.time_offset import estimate_time_offset

__all__ = [
    "calibrate_pointer",
    "estimate_time_offset",
    "fit_sphere",
    "register_surface",
    "register_tool",
    "solve_hand_eye",
    "solve_pivot",
]
