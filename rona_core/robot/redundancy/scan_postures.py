"""Postures of the robot during a scan, and rolls that follow another path in the same ones."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.arm import wrapped
from rona_core.robot.kinematics.link_errors import ALIKE_RAD, largest_step_rad
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.constant_roll import RollEvaluation, no_way, remove_rolls
from rona_core.robot.redundancy.infeasibility import FailureCause

TURNS_DEG = (90.0, -90.0, 60.0, -60.0, 30.0, -30.0)  # the first that is reached everywhere


def with_other_roll(model: RobotModel, qs_rad: Floats) -> tuple[float, Floats] | None:
    """Return by how much the roll was turned, in degrees, and the postures (n, 6) with it.

    Each is the one nearest to the posture it stands for; None where no turn of ``TURNS_DEG`` is
    within reach at all n places.

    Args:
        model: The robot.
        qs_rad: Postures (n, 6).
    """
    probes = model.forward(qs_rad) @ model.T_flange_probe
    rows = np.arange(len(qs_rad))
    for turn_deg in TURNS_DEG:
        turn = Pose.from_rotvec((0.0, 0.0, np.deg2rad(turn_deg)))
        found = model.inverse(probes @ (turn @ model.T_flange_probe.inv()))
        steps = wrapped(found.qs_rad - qs_rad[:, None])
        qs = qs_rad[:, None] + steps
        reached = found.valid & (model.limits.clearance_rad(qs).min(axis=2) >= 0.0)
        if len(rows) and reached.any(axis=1).all():
            away = np.where(reached, np.abs(steps).max(axis=2), np.inf)
            return turn_deg, qs[rows, np.argmin(away, axis=1)]
    return None


@dataclass(frozen=True, slots=True, eq=False)
class ScanPostures:
    """Joint angles (n, 6) at the A-scans, and the places (n, 3) of the probe's face in ``base``."""

    faces_base: Floats
    qs_rad: Floats

    def turned(self, model: RobotModel) -> "ScanPostures | None":
        """Return the postures at the same places with another roll; None where none is reached."""
        found = with_other_roll(model, self.qs_rad)
        return None if found is None else ScanPostures(self.faces_base, readonly(found[1]))

    def at(self, points_base: Floats) -> Floats:
        """Return the joint angles (m, 6) with which the robot came nearest to points (m, 3)."""
        return self.qs_rad[KDTree(self.faces_base).query(points_base)[1]]


def keep_postures(evaluation: RollEvaluation, postures: ScanPostures) -> RollEvaluation:
    """Return the rolls on those branches alone that follow the path as it was followed before.

    Where none does all along, those that come nearest.
    """
    wanted_rad = postures.at(evaluation.path.points_base)
    apart_rad = {
        (pair.index, pair.branch): largest_step_rad(
            evaluation.rolls.on_branch(pair.index, pair.branch).qs_rad.T, wanted_rad
        ).max()
        for pair in evaluation.ranked
    }
    most_rad = max(ALIKE_RAD, min(apart_rad.values(), default=0.0))
    away = {pair: _another_posture for pair, apart in apart_rad.items() if apart > most_rad}
    return remove_rolls(evaluation, away)


def _another_posture() -> tuple[int, FailureCause]:
    return 0, no_way("the posture is another one")
