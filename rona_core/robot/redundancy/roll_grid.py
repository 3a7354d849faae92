"""Inverse kinematics of a path for every roll of a working set, and the margin of each posture.

What counts here does not depend on the postures before: reach, singularities, and the limits with
the full turns that a joint may make. Arrays are contiguous along the path, which is how the
searches read them. See docs/algorithms/robot/roll_search.md.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.arm import N_BRANCHES
from rona_core.robot.kinematics.joint_limits import TURN_RAD, JointLimits
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.margins import (
    MarginLimits,
    as_poses,
    flange_parts,
    flange_poses,
    limit_margin,
    reach_margin,
    singularity_margin,
)

GROUP = 8192  # poses computed together; between groups the search can be cancelled
FULL_RAD = TURN_RAD - 1e-9
EDGE_RAD = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class RollPostures:
    """Joints and margins at n path points with some roll at each, on one branch."""

    qs_rad: Floats  # (n, 6)
    reach: Floats  # (n,) margin
    singularity: Floats  # (n,) margin
    limits: Floats  # (n, 6) margin of each joint


@dataclass(frozen=True, slots=True, eq=False)
class RollGrid:
    """Postures of the arm at n path points with R rolls on eight branches.

    Only working memory of a search: it is not stored, and its arrays may be written to.
    """

    path: Path5D  # dense, in ``base``
    model: RobotModel
    margin_limits: MarginLimits
    rolls_rad: Floats  # (R,) ascending, evenly spaced
    closed: bool  # the rolls make a full turn: the last neighbours the first
    flange_parts: Floats  # (3, n, 12), see ``flange_parts``
    qs_rad: Floats  # (8, 6, R, n) principal values
    margins: Floats  # (8, R, n) of each posture by itself; negative where it is not allowed
    singularity: Floats  # (8, R, n) margin to singularities alone
    turning: Bools  # (6,) joints that may stand whole turns away from their principal value

    @property
    def n_points(self) -> int:
        """Number of path points."""
        return self.margins.shape[2]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of path points, rolls and branches."""
        return self.margins.shape[2], self.margins.shape[1], self.margins.shape[0]

    @property
    def spacing_rad(self) -> float:
        """Roll from one to the next; a full turn where there is a single one."""
        return float(self.rolls_rad[1] - self.rolls_rad[0]) if len(self.rolls_rad) > 1 else TURN_RAD

    def flange_poses(self, rolls_rad: Floats) -> Poses:
        """Return ``Ts_base_flange`` (n,) for one roll at each path point."""
        return flange_poses(self.flange_parts, rolls_rad)

    def postures(self, branch: int, rolls_rad: Floats, near_rad: Floats) -> RollPostures:
        """Return the postures for rolls (n,), with the whole turns nearest to joints (n, 6)."""
        solutions = self.model.inverse(self.flange_poses(rolls_rad))
        qs = solutions.qs_rad[:, branch].copy()
        qs += TURN_RAD * np.where(self.turning, np.round((near_rad - qs) / TURN_RAD), 0.0)
        return RollPostures(
            qs_rad=qs,
            reach=reach_margin(solutions, self.margin_limits)[:, branch],
            singularity=singularity_margin(solutions, self.margin_limits)[:, branch],
            limits=self.model.limits.clearance_rad(qs) / self.margin_limits.limit_unit_rad,
        )


def turning_joints(limits: JointLimits) -> Bools:
    """Return which joints (6,) reach beyond half a turn, where principal values end."""
    far = np.maximum(-limits.lower_rad, limits.upper_rad)
    return limits.multi_turn() | (far > np.pi + EDGE_RAD)


def solve_roll_grid(
    path: Path5D,
    model: RobotModel,
    rolls_rad: Floats,
    margin_limits: MarginLimits,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RollGrid:
    """Solve the inverse kinematics of a path for every roll, and the margins of each posture.

    Args:
        path: The dense path in ``base``.
        model: The robot with its tool.
        rolls_rad: Rolls (R,), ascending and evenly spaced.
        margin_limits: What is allowed.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked between groups of rolls.

    Raises:
        DegenerateGeometryError: neighbouring axes of the path are opposite.
        CancelledError: ``cancel`` returned True.
    """
    n, count = len(path), len(rolls_rad)
    turning = turning_joints(model.limits)
    parts = flange_parts(path, model)
    qs = np.zeros((N_BRANCHES, 6, count, n))
    margins, singularity = np.zeros((2, N_BRANCHES, count, n))
    for group in roll_groups(count, n, progress, cancel):
        solutions = model.inverse(every_flange_pose(parts, rolls_rad[group]))
        shape = (N_BRANCHES, -1, n)
        qs[:, :, group] = solutions.qs_rad.transpose(1, 2, 0).reshape(N_BRANCHES, 6, -1, n)
        singularity[:, group] = singularity_margin(solutions, margin_limits).T.reshape(shape)
        np.minimum(
            singularity[:, group],
            reach_margin(solutions, margin_limits).T.reshape(shape),
            out=margins[:, group],
        )
        for branch in range(N_BRANCHES):
            limit = limit_margin(qs[branch, :, group], model.limits, turning, margin_limits)
            np.minimum(margins[branch, group], limit, out=margins[branch, group])
    span = float(rolls_rad[-1] - rolls_rad[0]) * count / max(1, count - 1)
    return RollGrid(
        path=path,
        model=model,
        margin_limits=margin_limits,
        rolls_rad=rolls_rad,
        closed=count > 1 and span > FULL_RAD,
        flange_parts=parts,
        qs_rad=qs,
        margins=margins,
        singularity=singularity,
        turning=turning,
    )


def roll_groups(count: int, n: int, progress: Progress, cancel: Cancel) -> Iterator[slice]:
    """Yield the groups in which rolls are worked on.

    Args:
        count: Number of rolls.
        n: Number of path points.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked between groups.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    at_once = max(1, GROUP // n)
    for start in range(0, count, at_once):
        if cancel():
            raise CancelledError(f"the roll search was cancelled after {start} of {count} rolls")
        stop = min(start + at_once, count)
        yield slice(start, stop)
        progress(stop / count)


def every_flange_pose(parts: Floats, rolls_rad: Floats) -> Poses:
    """Return the poses of all points for the first roll, then for the second, and so on."""
    c, s = (f(rolls_rad)[:, None, None] for f in (np.cos, np.sin))
    return as_poses((parts[0] * c + parts[1] * s + parts[2]).reshape(-1, 12))
