"""All postures along a path for every roll of a working set, and the room of each by itself.

What counts here does not depend on the way a posture is come to: reach, singularities, and the
limits with the full turns that a joint may make. Arrays are contiguous along the path, which is
how both searches read them. See docs/algorithms/robot/roll_search.md.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.joint_limits import TURN_RAD, JointLimits
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.kinematics.spherical_wrist import N_BRANCHES, IkSolutions
from rona_core.robot.redundancy.margins import ROUNDED_MM, RoomRules, singular_room

GROUP = 8192  # poses worked on together; between groups somebody may cancel
FULL_RAD = TURN_RAD - 1e-9
EDGE_RAD = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class RollGrid:
    """Postures of the arm at n path points with R rolls on eight branches.

    Only working memory of a search: it is not stored, and its arrays may be written to.
    """

    rolls_rad: Floats  # (R,) ascending, evenly spaced
    closed: bool  # the rolls make a full turn: the last neighbours the first
    qs_rad: Floats  # (8, 6, R, n) principal values
    room: Floats  # (8, R, n) of each posture by itself; negative where it is not allowed
    singular: Floats  # (8, R, n) room to singularities alone
    turning: Bools  # (6,) joints that may stand whole turns away from their principal value

    @property
    def n_points(self) -> int:
        """Number of path points."""
        return self.room.shape[2]

    @property
    def spacing_rad(self) -> float:
        """Roll from one to the next; a full turn where there is a single one."""
        return float(self.rolls_rad[1] - self.rolls_rad[0]) if len(self.rolls_rad) > 1 else TURN_RAD


def turning_joints(limits: JointLimits) -> Bools:
    """Return which joints (6,) reach beyond half a turn, where principal values end."""
    far = np.maximum(-limits.lower_rad, limits.upper_rad)
    return limits.multi_turn() | (far > np.pi + EDGE_RAD)


def roll_grid(
    path: Path5D,
    model: RobotModel,
    rolls_rad: Floats,
    rules: RoomRules,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RollGrid:
    """Solve the inverse kinematics of a path for every roll, and judge each posture by itself.

    Args:
        path: The dense path in ``base``.
        model: The robot with its tool.
        rolls_rad: Rolls (R,), ascending and evenly spaced.
        rules: What is allowed.
        progress: Told the share that is done.
        cancel: Asked between groups of rolls.

    Raises:
        DegenerateGeometryError: neighbouring axes of the path are opposite.
        CancelledError: somebody cancelled.
    """
    n, count = len(path), len(rolls_rad)
    turning = turning_joints(model.limits)
    parts = flange_parts(path, model)
    qs = np.zeros((N_BRANCHES, 6, count, n))
    room, singular = np.zeros((2, N_BRANCHES, count, n))
    at_once = max(1, GROUP // n)
    for start in range(0, count, at_once):
        if cancel():
            raise CancelledError(f"the roll search was cancelled after {start} of {count} rolls")
        group = slice(start, min(start + at_once, count))
        solutions = model.inverse(_flange_poses(parts, rolls_rad[group]))
        shape = (N_BRANCHES, -1, n)
        qs[:, :, group] = solutions.qs_rad.transpose(1, 2, 0).reshape(N_BRANCHES, 6, -1, n)
        singular[:, group] = singular_room(solutions, rules).T.reshape(shape)
        np.minimum(
            singular[:, group],
            reach_room(solutions, rules).T.reshape(shape),
            out=room[:, group],
        )
        for branch in range(N_BRANCHES):
            least = limit_room(qs[branch, :, group], model.limits, turning, rules)
            np.minimum(room[branch, group], least, out=room[branch, group])
        progress(group.stop / count)
    span = float(rolls_rad[-1] - rolls_rad[0]) * count / max(1, count - 1)
    return RollGrid(rolls_rad, count > 1 and span > FULL_RAD, qs, room, singular, turning)


def follow_poses(parts: Floats, rolls_rad: Floats) -> Poses:
    """Return ``Ts_base_flange`` (n,) for one roll at each path point, from ``flange_parts``."""
    c, s = np.cos(rolls_rad)[:, None], np.sin(rolls_rad)[:, None]
    return _as_poses(parts[0] * c + parts[1] * s + parts[2])


def reach_room(solutions: IkSolutions, rules: RoomRules) -> Floats:
    """Return the room (n, 8) to the end of the reach; negative outside."""
    outside = np.minimum(solutions.reaches_mm, -ROUNDED_MM)
    inside = np.maximum(solutions.reaches_mm, 0.0)
    return np.where(solutions.valid, inside, outside) / rules.reach_unit_mm


def limit_room(qs_rad: Floats, limits: JointLimits, turning: Bools, rules: RoomRules) -> Floats:
    """Return the room (...) to the joint limits of postures (6, ...), turned as suits best."""
    least = np.full(qs_rad.shape[1:], np.inf)
    for joint in range(6):
        lower, upper = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
        away = np.abs(qs_rad[joint] - (lower + upper) / 2.0)
        if turning[joint]:
            away = np.abs(away - TURN_RAD * np.round(away / TURN_RAD))
        np.minimum(least, (upper - lower) / 2.0 - away, out=least)
    return least / rules.limit_unit_rad


def flange_parts(path: Path5D, model: RobotModel) -> Floats:
    """Return three parts (3, n, 12) of the flange poses: times cos roll, times sin roll, fixed.

    Each row is a rotation, row by row, and a translation.
    """
    T_probe_flange = model.T_flange_probe.inv()
    frames = path.Ts_base_probe(0.0).rotations
    tool = np.hstack((T_probe_flange.rotation, T_probe_flange.translation[:, None]))  # (3, 4)
    x, y, z = (frames[:, :, i, None] for i in range(3))
    turned = x * tool[0] + y * tool[1], y * tool[0] - x * tool[1], z * tool[2]  # (n, 3, 4) each
    parts = np.stack(turned)
    parts[2, :, :, 3] += path.points_base
    whole = (parts[..., :3].reshape(3, -1, 9), parts[..., 3])
    return np.concatenate(whole, axis=2)


def _flange_poses(parts: Floats, rolls_rad: Floats) -> Poses:
    """Return the poses of all points for the first roll, then for the second, and so on."""
    c, s = (f(rolls_rad)[:, None, None] for f in (np.cos, np.sin))
    return _as_poses((parts[0] * c + parts[1] * s + parts[2]).reshape(-1, 12))


def _as_poses(rows: Floats) -> Poses:
    return Poses(rows[:, :9].reshape(-1, 3, 3), rows[:, 9:])
