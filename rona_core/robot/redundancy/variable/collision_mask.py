"""Postures that a varying roll must keep away from: collisions, and ends without a retraction."""

import numpy as np

from rona_core.geometry.arrays import Bools, Ints
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.redundancy.margins import limit_margin, reach_margin
from rona_core.robot.redundancy.roll_grid import RollGrid, flange_poses

MOST_POINTS = 32  # path points whose postures are all checked in one go


def blocked_retracts(grid: RollGrid, standoff_mm: float) -> Bools:
    """Return the postures (2, R, 8) at both ends from which the probe cannot be retracted.

    Args:
        grid: Postures along the path.
        standoff_mm: How far it has to be retracted along its axis.
    """
    ends, n_rolls, model = [0, grid.n_points - 1], len(grid.rolls_rad), grid.model
    parts = grid.flange_parts[:, ends]
    parts[2, :, 9:] -= standoff_mm * grid.path.axes_base[ends]
    result = np.zeros((2, n_rolls, len(grid.margins)), dtype=np.bool_)
    for end in range(2):
        parts_at_end = np.repeat(parts[:, end : end + 1], n_rolls, axis=1)
        solutions = model.inverse(flange_poses(parts_at_end, grid.rolls_rad))
        angles = solutions.qs_rad.transpose(2, 0, 1)
        limit = limit_margin(angles, model.limits, grid.turning, grid.margin_limits)
        result[end] = np.minimum(limit, reach_margin(solutions, grid.margin_limits)) < 0.0
    return result


def block_collisions(
    blocked: Bools, grid: RollGrid, points: Ints, clear: Clear, allowed: Bools
) -> None:
    """Mark in ``blocked`` (n, R, 8) the postures that touch something at some path points.

    Of many points some are checked, spread evenly, and stand for their neighbours. Postures that
    are not allowed anyway are not checked.

    Args:
        blocked: Written to.
        grid: Postures along the path.
        points: Path points to check, ascending.
        clear: Tells for joint angles (m, 6) where nothing touches.
        allowed: Postures (8, R, n) that are allowed otherwise.
    """
    most = np.linspace(0, len(points) - 1, MOST_POINTS)
    some = points if len(points) <= MOST_POINTS else points[np.unique(most.astype(np.int64))]
    touches = np.zeros((len(some), len(grid.rolls_rad), len(grid.margins)), dtype=np.bool_)
    for row, point in enumerate(some):
        branch, roll = np.nonzero(allowed[:, :, point])
        if len(branch):
            touches[row, roll, branch] = ~clear(grid.qs_rad[branch, :, roll, point])
    nearest = np.abs(points[:, None] - some).argmin(axis=1)
    blocked[points] |= touches[nearest]
