"""How far one way to follow a path stays from each border, at every path point."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.margins import RoomRules, judge
from rona_core.robot.redundancy.roll_grid import flange_parts, follow_poses


@dataclass(frozen=True, slots=True, eq=False)
class Margins:
    """Room by cause, see docs/algorithms/robot/roll_search.md; below 0 is not allowed."""

    qs_rad: Floats  # (n, 6) continuous
    least: Floats  # (n,) of all causes
    singularity: Floats  # (n,) to the nearest of elbow, wrist and shoulder singularity
    limit_deg: Floats  # (n,) of the joint that is nearest to a limit


def margins(
    path: Path5D,
    model: RobotModel,
    rolls_rad: ArrayLike,
    branch: int,
    rules: RoomRules | None = None,
) -> Margins:
    """Return the margins of one branch with a roll for the whole path, or one a point (n,)."""
    rolls = np.broadcast_to(np.asarray(rolls_rad, dtype=np.float64), (len(path),))
    room = judge(model, follow_poses(flange_parts(path, model), rolls), rules or RoomRules())
    qs = room.qs_rad[:, branch]
    return Margins(
        qs_rad=readonly(qs.copy()),
        least=readonly(room.least()[:, branch].copy()),
        singularity=readonly(room.singularity[:, branch].copy()),
        limit_deg=readonly(np.rad2deg(model.limits.clearance_rad(qs).min(axis=1))),
    )
