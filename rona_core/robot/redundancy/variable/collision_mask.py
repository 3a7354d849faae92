"""Postures that a varying roll must keep away from: those that touch something, and dead ends."""

import numpy as np

from rona_core.geometry.arrays import Bools, Ints
from rona_core.geometry.path5d import Path5D
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.margins import RoomRules
from rona_core.robot.redundancy.roll_grid import (
    RollGrid,
    flange_parts,
    follow_poses,
    limit_room,
    reach_room,
)

MOST_POINTS = 32  # path points whose postures are all looked at in one go


def dead_ends(
    path: Path5D, model: RobotModel, grid: RollGrid, rules: RoomRules, standoff_mm: float
) -> Bools:
    """Return the postures (2, R, 8) at both ends from which the probe cannot be drawn back.

    Args:
        path: The dense path in ``base``.
        model: The robot with its tool.
        grid: Its postures along the path.
        rules: The units of room.
        standoff_mm: How far it has to be drawn back along its axis.
    """
    ends = [0, len(path) - 1]
    parts = flange_parts(path, model)[:, ends]
    parts[2, :, 9:] -= standoff_mm * path.axes_base[ends]
    result = np.zeros((2, len(grid.rolls_rad), len(grid.room)), dtype=np.bool_)
    for end in range(2):
        at_end = np.repeat(parts[:, end : end + 1], len(grid.rolls_rad), axis=1)
        solutions = model.inverse(follow_poses(at_end, grid.rolls_rad))
        angles = solutions.qs_rad.transpose(2, 0, 1)
        limits = limit_room(angles, model.limits, grid.turning, rules)
        result[end] = np.minimum(limits, reach_room(solutions, rules)) < 0.0
    return result


def touching(grid: RollGrid, points: Ints, clear: Clear, allowed: Bools) -> tuple[Ints, Bools]:
    """Return some of the path points, and which of their postures (m, R, 8) touch something.

    Of many points some are looked at, spread evenly. Postures that are not allowed anyway are not
    looked at and count as free.

    Args:
        grid: Postures along the path.
        points: Path points to look at, ascending.
        clear: Tells where nothing touches.
        allowed: Postures (8, R, n) that are allowed otherwise.
    """
    most = np.linspace(0, len(points) - 1, MOST_POINTS)
    some = points if len(points) <= MOST_POINTS else points[np.unique(most.astype(np.int64))]
    result = np.zeros((len(some), len(grid.rolls_rad), len(grid.room)), dtype=np.bool_)
    for row, point in enumerate(some):
        branch, roll = np.nonzero(allowed[:, :, point])
        if len(branch):
            result[row, roll, branch] = ~clear(grid.qs_rad[branch, :, roll, point])
    return some, result


def shut_out(blocked: Bools, points: Ints, some: Ints, touches: Bools) -> None:
    """Mark in ``blocked`` (n, R, 8) what touches at some points, at their neighbours too.

    Args:
        blocked: Written to.
        points: All path points that were asked about, ascending.
        some: Those of them that were looked at.
        touches: What touches there, (m, R, 8).
    """
    nearest = np.abs(points[:, None] - some).argmin(axis=1)
    blocked[points] |= touches[nearest]
