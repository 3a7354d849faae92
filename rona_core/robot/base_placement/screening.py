"""Judge a scan path quickly from many places of the robot's base.

Only some points of the path are looked at, with all rolls and branches at once, and jumps are not:
good enough to find places that are worth a full look. See docs/algorithms/robot/base_placement.md.
"""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.joint_limits import TURN_RAD, unwrap
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.margins import RoomRules, singular_room
from rona_core.robot.redundancy.roll_grid import reach_room

NOTHING_WORKS = -100.0  # room no worse than this is told apart
NEARLY_ROUND_RAD = float(np.deg2rad(300.0))  # a joint of this range may pass +-180 degrees


class Screen:
    """The margin of one scan path as a function of where the base stands."""

    def __init__(
        self, path: Path5D, model: RobotModel, rules: RoomRules, n_points: int, n_rolls: int
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
        self._model, self._rules, self._n_points = model, rules, len(chosen)
        multi, ranges_rad = model.limits.multi_turn(), model.upper_rad - model.lower_rad
        self._unwrapped = [joint for joint in range(6) if ranges_rad[joint] >= NEARLY_ROUND_RAD]
        self._shifted = [joint for joint in self._unwrapped if multi[joint]]

    def margin(self, old_in_new: Pose) -> float:
        """Return the least room along the path with the best roll and branch.

        Args:
            old_in_new: Where the base that the path refers to stands, seen from the new place.
        """
        solutions = self._model.inverse(old_in_new @ self._Ts_base_flange)
        rules, limits = self._rules, self._model.limits
        room = np.minimum(reach_room(solutions, rules), singular_room(solutions, rules))
        least = room.reshape(self._n_points, -1).min(axis=0)  # (rolls * branches,)
        qs = self._followed(solutions.qs_rad.reshape(self._n_points, -1, 6))
        clearance = limits.clearance_rad(qs).min(axis=(0, 2)) / rules.limit_unit_rad
        return float(max(np.minimum(least, clearance).max(), NOTHING_WORKS))

    def _followed(self, qs_rad: Floats) -> Floats:
        """Return joint angles (n, k, 6) made continuous, moved by full turns into the limits."""
        qs = qs_rad.copy()
        qs[:, :, self._unwrapped] = unwrap(qs[:, :, self._unwrapped])
        limits = self._model.limits
        for joint in self._shifted:
            middle = (limits.lower_rad[joint] + limits.upper_rad[joint]) / 2.0
            low, high = qs[:, :, joint].min(axis=0), qs[:, :, joint].max(axis=0)
            qs[:, :, joint] += TURN_RAD * np.round((middle - (low + high) / 2.0) / TURN_RAD)
        return qs
