"""Joint paths that follow a scan path with a given roll on one branch, and their margins."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.margins import JointMargins, MarginLimits, compute_margins
from rona_core.robot.redundancy.roll_grid import flange_parts, flange_poses


@dataclass(frozen=True, slots=True, eq=False)
class BranchMargins:
    """Margins of one branch by cause; negative is not allowed (see ``margins``)."""

    qs_rad: Floats  # (n, 6) continuous
    least: Floats  # (n,) of all causes
    singularity: Floats  # (n,) to the nearest of elbow, wrist and shoulder singularity
    limit_deg: Floats  # (n,) of the joint that is nearest to a limit


def joint_path(
    path: Path5D,
    model: RobotModel,
    rolls_rad: ArrayLike,
    branch: int,
    margin_limits: MarginLimits | None = None,
) -> Floats:
    """Return joint angles (n, 6) along the path for one branch, continuous.

    Args:
        path: The path in ``base``.
        model: The robot with its tool.
        rolls_rad: One roll, or one at each path point (n,).
        branch: Index into ``kinematics.arm.BRANCHES``.
        margin_limits: What is allowed.
    """
    margins = _margins(path, model, rolls_rad, margin_limits)
    return readonly(margins.qs_rad[:, branch].copy())


def branch_margins(
    path: Path5D,
    model: RobotModel,
    rolls_rad: ArrayLike,
    branch: int,
    margin_limits: MarginLimits | None = None,
) -> BranchMargins:
    """Return the margins of the ``joint_path`` with the same arguments."""
    margins = _margins(path, model, rolls_rad, margin_limits)
    qs = margins.qs_rad[:, branch]
    return BranchMargins(
        qs_rad=readonly(qs.copy()),
        least=readonly(margins.least()[:, branch].copy()),
        singularity=readonly(margins.singularity[:, branch].copy()),
        limit_deg=readonly(np.rad2deg(model.limits.clearance_rad(qs).min(axis=1))),
    )


def _margins(
    path: Path5D, model: RobotModel, rolls_rad: ArrayLike, margin_limits: MarginLimits | None
) -> JointMargins:
    rolls = np.broadcast_to(np.asarray(rolls_rad, dtype=np.float64), (len(path),))
    poses = flange_poses(flange_parts(path, model), rolls)
    return compute_margins(model, poses, margin_limits or MarginLimits())
