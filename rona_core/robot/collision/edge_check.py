"""Collision checks along straight joint moves, at steps that leave no gap for the arm."""

from collections.abc import Callable

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.robot_model import RobotModel

Clear = Callable[[Floats], Bools]  # joint angles (n, 6) -> (n,): nothing is touched

STEP_RAD = float(np.deg2rad(2.0))  # between places that are looked at, of any joint
STEP_MM = 5.0  # likewise of any point of the arm
MOST_CHECKS = 60_000  # places looked at before giving up
BATCH = 48  # places looked at together
NEAR_MM = 65.0  # of a path point: nearer than this the probe must stay outside the bone


def outside_bone(path: Path5D, model: RobotModel, clear: Clear | None = None) -> Clear:
    """Return a test that the probe does not dip under the path, besides another test if given.

    Where nothing else of the surroundings is given, there is bone under the path.
    """
    tree = KDTree(path.points_base)

    def test(qs_rad: Floats) -> Bools:
        probes_base = (model.forward(qs_rad) @ model.T_flange_probe).translations
        distances, nearest = tree.query(probes_base)
        away = probes_base - path.points_base[nearest]
        depths = np.einsum("ij,ij->i", away, path.axes_base[nearest])
        good: Bools = (distances > NEAR_MM) | (depths <= 0.0)
        return good if clear is None or not good.any() else good & clear(qs_rad)

    return test


class Checker:
    """Looks whether moves are clear, closely enough, and counts what it looked at."""

    def __init__(self, model: RobotModel, clear: Clear, most: int = MOST_CHECKS) -> None:
        """Keep the model, the test of single places and how many of them may be tested."""
        self.model, self._clear, self._most = model, clear, most
        self.checks = 0

    @property
    def spent(self) -> bool:
        """Whether as many places were looked at as was allowed."""
        return self.checks >= self._most

    def place(self, q_rad: Floats) -> bool:
        """Return whether the robot may stand at joint angles (6,)."""
        self.checks += 1
        return bool(self._clear(q_rad[None])[0])

    def move(self, q_from_rad: Floats, q_to_rad: Floats, coarse: int = 1) -> bool:
        """Return whether the straight move is clear; its start is taken to be.

        ``coarse`` times as far apart as usual is good enough for a first look.
        """
        return self.clear_share(q_from_rad, q_to_rad, coarse) == 1.0

    def clear_share(self, q_from_rad: Floats, q_to_rad: Floats, coarse: int = 1) -> float:
        """Return the share of the straight move, 0 to 1, up to the last place that is clear."""
        count = -(-n_steps(self.model, q_from_rad, q_to_rad) // coarse)
        shares = np.arange(1, count + 1, dtype=np.float64) / count
        for first in range(0, count, BATCH):
            batch = shares[first : first + BATCH]
            good = self._clear(q_from_rad + batch[:, None] * (q_to_rad - q_from_rad))
            self.checks += len(batch)
            if not good.all():
                return float((first + int(np.argmin(good))) / count)
        return 1.0


def n_steps(model: RobotModel, q_from_rad: Floats, q_to_rad: Floats) -> int:
    """Return into how many steps a straight move is cut to be looked at.

    No joint turns by more than ``STEP_RAD`` in a step, and no joint, tip or marker of the tool
    moves by more than about ``STEP_MM``.
    """
    turns = np.abs(q_to_rad - q_from_rad)
    arms_mm = np.zeros((6, 9))
    for q in (q_from_rad, (q_from_rad + q_to_rad) / 2.0, q_to_rad):
        links = model.joint_poses(q)
        flange = model.forward(q[None])[0]
        tool = (flange @ model.T_flange_tip, flange @ model.T_flange_toolmarker)
        points = np.vstack((links.translations, *(pose.translation for pose in tool)))
        for joint in range(6):  # the axis runs through the frame of this link or the one before
            gaps = np.linalg.norm(points - links.translations[joint + 1], axis=1)
            before = np.linalg.norm(points - links.translations[joint], axis=1)
            far = np.maximum(gaps, before)
            far[: joint + 1] = 0.0  # these do not move with the joint
            arms_mm[joint] = np.maximum(arms_mm[joint], far)
    way_mm = float((turns @ arms_mm).max())
    return max(1, int(np.ceil(max(turns.max() / STEP_RAD, way_mm / STEP_MM) - 1e-9)))
