"""Coarse screening of base places: the margin of a scan path from many places of the base.

Only some points of the path are checked, with all rolls and branches at once, and no jumps: good
enough to find places that are worth planning in full. See docs/algorithms/robot/base_placement.md.
"""

import numpy as np

from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.joint_limits import TURN_RAD
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.margins import (
    MarginLimits,
    continuous_branches,
    reach_margin,
    singularity_margin,
)

NOTHING_WORKS = -100.0  # margins below this are not told apart


class CoarseScreening:
    """The margin of one scan path as a function of where the base stands."""

    def __init__(
        self,
        path: Path5D,
        model: RobotModel,
        margin_limits: MarginLimits,
        n_points: int,
        n_rolls: int,
    ) -> None:
        """Lay out the flange poses of all rolls at evenly chosen points of a dense path.

        The roll is carried along the whole path first: what is constant seen from here is constant
        seen from any other place.
        """
        chosen = np.unique(np.round(np.linspace(0, len(path) - 1, n_points)).astype(np.int64))
        zero = path.Ts_base_probe(0.0).select(chosen)
        rolls_rad = TURN_RAD * np.arange(n_rolls) / n_rolls
        c, s = np.cos(rolls_rad), np.sin(rolls_rad)
        turns = np.zeros((n_rolls, 3, 3))
        turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1] = c, -s, s, c
        turns[:, 2, 2] = 1.0
        rotations = (zero.rotations[:, None] @ turns).reshape(-1, 3, 3)
        places = np.repeat(zero.translations, n_rolls, axis=0)
        self._Ts_base_flange = Poses(rotations, places) @ model.T_flange_probe.inv()
        self._model, self._margin_limits, self._n_points = model, margin_limits, len(chosen)

    def margin(self, old_in_new: Pose) -> float:
        """Return the least margin along the path with the best roll and branch.

        Args:
            old_in_new: Where the base that the path refers to stands, seen from the new place.
        """
        solutions = self._model.inverse(old_in_new @ self._Ts_base_flange)
        margin_limits, limits = self._margin_limits, self._model.limits
        margin = np.minimum(
            reach_margin(solutions, margin_limits), singularity_margin(solutions, margin_limits)
        )
        least = margin.reshape(self._n_points, -1).min(axis=0)  # (rolls * branches,)
        qs = continuous_branches(solutions.qs_rad.reshape(self._n_points, -1, 6), limits)
        clearance = limits.clearance_rad(qs).min(axis=(0, 2)) / margin_limits.limit_unit_rad
        return float(max(np.minimum(least, clearance).max(), NOTHING_WORKS))
