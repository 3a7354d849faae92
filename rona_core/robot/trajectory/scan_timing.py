"""Timing of a scan: approach, scan at constant speed where the joints allow, retract."""

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.robot.collision.edge_check import Clear, outside_bone
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.corner_blend import blend_corners
from rona_core.robot.trajectory.joint_moves import chain, clear_move
from rona_core.robot.trajectory.path_timing import (
    ScanSettings,
    sample_path,
    speed_limits,
    timed_line,
)
from rona_core.robot.trajectory.retract import retract_line
from rona_core.robot.trajectory.time_parameterization import MERGED, kept
from rona_core.robot.trajectory.trajectory import SAMPLE_S, Trajectory

TURN_WAY_MM = 10.0  # a turn of one radian on the spot counts as this much way


def time_scan(
    path: Path5D,
    qs_rad: Floats,
    model: RobotModel,
    settings: ScanSettings,
    *,
    clear: Clear | None = None,
) -> Trajectory:
    """Return the whole motion of a scan, from rest to rest.

    From home in joint space to the stand-off, straight down to the first path point, along the
    path, straight up from the last point, and home again. Where the joints do not allow the whole
    stand-off, it is as long as they do.

    Args:
        path: The dense scan path in ``base``.
        qs_rad: Joint angles (n, 6) that follow it, continuous, one branch.
        model: The robot with its tool.
        settings: Speeds and stand-off.
        clear: Tells for joint angles (n, 6) where nothing is touched. Approach and retract go
            around what is in the way. None: nothing is known but the bone under the path.

    Raises:
        InvalidInputError: not one joint vector for each path point, or a path without length.
        NotReachableError: the probe cannot be drawn back from an end of the path, or there is no
            clear way from the start or back.
    """
    if qs_rad.shape != (len(path), 6):
        raise InvalidInputError(f"qs_rad must have shape ({len(path)}, 6), not {qs_rad.shape}")
    down = retract_line(model, qs_rad[0], settings.standoff_mm, clear)[::-1]
    up = retract_line(model, qs_rad[-1], settings.standoff_mm, clear)
    way, along = _way(path), path.arc_length_mm()
    scan_ways, scan = _timed_scan(way, qs_rad, model, settings)
    free, home = outside_bone(path, model, clear), model.home_rad
    before = chain((clear_move(model, home, down[0], free), timed_line(down, settings, model)))
    after = chain((timed_line(up, settings, model), clear_move(model, up[-1], home, free)))
    qs = chain((before, scan, after))
    path_mm = np.full(len(qs), along[-1])
    path_mm[: len(before)] = 0.0
    first, last = len(before) - 1, len(before) + len(scan) - 2
    path_mm[first : last + 1] = np.interp(scan_ways, way, along)
    return Trajectory(
        times_s=readonly(np.arange(len(qs), dtype=np.float64) * SAMPLE_S),
        qs_rad=readonly(qs),
        scan_start_s=SAMPLE_S * first,
        scan_end_s=SAMPLE_S * last,
        path_mm=readonly(path_mm),
    )


def _timed_scan(
    way_mm: Floats, qs_rad: Floats, model: RobotModel, settings: ScanSettings
) -> tuple[Floats, Floats]:
    """Return way (m,) and joints (m, 6) of the scan, its corners rounded."""
    keep = kept(way_mm)
    if np.count_nonzero(keep) < 2 or way_mm[-1] <= MERGED:
        raise InvalidInputError("a path without length cannot be timed; it needs two places")
    rounded = blend_corners(way_mm[keep], qs_rad[keep], model, settings.corner_deviation_mm)
    limits = speed_limits(settings, settings.scan_speed_mm_per_s)
    return sample_path(rounded.way_mm, rounded.qs_rad, rounded.points_base, limits, model)


def _way(path: Path5D) -> Floats:
    """Return the way (n,) along the path: its length, or where it turns on the spot, the turn."""
    steps_mm, turns_rad = path.steps()
    turns_rad[turns_rad < 1e-6] = 0.0  # rounding, not a turn
    return np.concatenate(([0.0], np.cumsum(np.maximum(steps_mm, TURN_WAY_MM * turns_rad))))
