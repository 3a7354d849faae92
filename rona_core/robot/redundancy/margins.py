"""Joint paths that follow a scan path, and their margins to limits, singularities and jumps.

A margin is a plain number: the distance from the border of what is allowed, in units of a size
that is comfortable for that quantity. A negative margin is not allowed. See
docs/algorithms/robot/roll_search.md.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.arm import IkSolutions
from rona_core.robot.kinematics.joint_limits import TURN_RAD, JointLimits, shift_to_fit
from rona_core.robot.kinematics.robot_model import RobotModel

SINGULARITY_MARGIN_RAD = float(np.deg2rad(5.0))  # least angle of elbow and wrist from straight
SHOULDER_MARGIN_MM = 30.0  # least distance of the wrist centre from axis 1
LARGEST_STEP_RAD = float(np.deg2rad(10.0))  # of a joint between dense samples

EVEN_DIGITS = 9  # decimals in which margins must differ to count as different
AT_ONCE = 2048  # poses of a joint path that are solved together, on all branches
ROUNDED_MM = 1e-9  # a pose that cannot be reached is outside by at least this much


@dataclass(frozen=True, slots=True)
class MarginLimits:
    """What is allowed along a path, and what counts as one unit of margin."""

    singular_rad: float = SINGULARITY_MARGIN_RAD
    shoulder_mm: float = SHOULDER_MARGIN_MM
    step_rad: float = LARGEST_STEP_RAD
    limit_unit_rad: float = float(np.deg2rad(20.0))
    singular_unit: float = float(np.sin(np.deg2rad(20.0)))
    shoulder_unit_mm: float = 150.0
    step_unit_rad: float = float(np.deg2rad(5.0))
    reach_unit_mm: float = 100.0

    def __post_init__(self) -> None:
        require(0.0 < self.singular_rad < np.pi / 2, "singular_rad must be 0 to pi/2")
        require(self.shoulder_mm >= 0.0, "shoulder_mm must not be negative")
        require(0.0 < self.step_rad < np.pi, "step_rad must be 0 to pi")


@dataclass(frozen=True, slots=True, eq=False)
class JointMargins:
    """Margins of all branches over n samples, by cause; the least of them decides."""

    qs_rad: Floats  # (n, 8, 6) continuous, turns chosen to fit the limits
    reach: Floats  # (n, 8)
    singularity: Floats  # (n, 8)
    limit: Floats  # (n, 8)
    jump: Floats  # (n, 8) of the step that leads to the sample

    def least(self) -> Floats:
        """Return the least margin (n, 8) of each sample."""
        return np.minimum(
            np.minimum(self.reach, self.singularity), np.minimum(self.limit, self.jump)
        )


def compute_margins(
    model: RobotModel,
    Ts_base_flange: Poses,
    margin_limits: MarginLimits,
    branches: slice = slice(None),
) -> JointMargins:
    """Compute the margins of branches, by default of all eight, along flange poses."""
    solutions = model.inverse(Ts_base_flange)
    qs = continuous_branches(solutions.qs_rad[:, branches], model.limits)
    steps = np.abs(np.diff(qs, axis=0)).max(axis=2, initial=0.0)
    jump = np.full(qs.shape[:2], margin_limits.step_rad / margin_limits.step_unit_rad)
    jump[1:] = (margin_limits.step_rad - steps) / margin_limits.step_unit_rad
    return JointMargins(
        qs_rad=qs,
        reach=reach_margin(solutions, margin_limits)[:, branches],
        singularity=singularity_margin(solutions, margin_limits)[:, branches],
        limit=model.limits.clearance_rad(qs).min(axis=2) / margin_limits.limit_unit_rad,
        jump=jump,
    )


def reach_margin(solutions: IkSolutions, margin_limits: MarginLimits) -> Floats:
    """Return the margin (n, 8) to the end of the reach; negative outside."""
    outside = np.minimum(solutions.reaches_mm, -ROUNDED_MM)
    inside = np.maximum(solutions.reaches_mm, 0.0)
    return np.where(solutions.valid, inside, outside) / margin_limits.reach_unit_mm


def singularity_margin(solutions: IkSolutions, margin_limits: MarginLimits) -> Floats:
    """Return the margin (n, 8) to the nearest of elbow, wrist and shoulder singularity."""
    sine = np.minimum(solutions.sin_wrist, solutions.sin_elbows)
    angular = (sine - np.sin(margin_limits.singular_rad)) / margin_limits.singular_unit
    shoulder_mm = solutions.wrist_distance_mm - margin_limits.shoulder_mm
    return np.minimum(angular, (shoulder_mm / margin_limits.shoulder_unit_mm)[:, None])


def limit_margin(
    qs_rad: Floats, limits: JointLimits, turning: Bools, margin_limits: MarginLimits
) -> Floats:
    """Return the margin (...) to the joint limits of postures (6, ...), at their best whole turns.

    Args:
        qs_rad: Principal values of the joint angles (6, ...).
        limits: The joint limits.
        turning: Joints (6,) that may stand whole turns away from their principal value.
        margin_limits: The units.
    """
    return np.minimum.reduce(
        [
            joint_limit_margin(qs_rad[joint], limits, joint, margin_limits, turning=turning[joint])
            for joint in range(6)
        ]
    )


def joint_limit_margin(
    q_rad: Floats, limits: JointLimits, joint: int, margin_limits: MarginLimits, *, turning: bool
) -> Floats:
    """Return the margin (...) of one joint to its limits; if ``turning``, at its best turn."""
    lower, upper = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
    off_middle = np.abs(q_rad - (lower + upper) / 2.0)
    if turning:
        off_middle = np.abs(off_middle - TURN_RAD * np.round(off_middle / TURN_RAD))
    return ((upper - lower) / 2.0 - off_middle) / margin_limits.limit_unit_rad


def continuous_branches(qs_rad: Floats, limits: JointLimits) -> Floats:
    """Return joints (n, b, 6) with spinning ones unwrapped and shifted by full turns to fit."""
    qs = qs_rad.copy()
    if not len(qs):
        return qs
    spinning = list(limits.spinning())
    qs[:, :, spinning] = np.unwrap(qs[:, :, spinning], axis=0)
    for joint in np.flatnonzero(limits.multi_turn()):
        lower, upper = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
        qs[:, :, joint] = shift_to_fit(qs[:, :, joint], lower, upper)
    return qs


def flange_poses(parts: Floats, rolls_rad: Floats) -> Poses:
    """Return ``Ts_base_flange`` (n,) for one roll at each path point, from ``flange_parts``."""
    c, s = np.cos(rolls_rad)[:, None], np.sin(rolls_rad)[:, None]
    return as_poses(parts[0] * c + parts[1] * s + parts[2])


@lru_cache(maxsize=1)  # a path is solved for one group of rolls after the other
def flange_parts(path: Path5D, model: RobotModel) -> Floats:
    """Return three parts (3, n, 12) of the flange poses: times cos roll, times sin roll, fixed.

    Each row is a rotation, row by row, and a translation.
    """
    T_probe_flange = model.T_flange_probe.inv()
    frames = path.Ts_base_probe(0.0).rotations
    tool = np.hstack((T_probe_flange.rotation, T_probe_flange.translation[:, None]))  # (3, 4)
    parts = np.zeros((3, len(frames), 12))
    x, y, z = (frames[:, :, i, None] for i in range(3))
    for some, rows in ((slice(3), slice(9)), (slice(3, 4), slice(9, 12))):
        a, b, c = tool[:, some]
        kept = parts[:, :, rows].reshape(3, -1, 3, len(a))  # what is written here is written there
        np.add(x * a, y * b, out=kept[0])
        np.subtract(y * a, x * b, out=kept[1])
        np.multiply(z, c, out=kept[2])
    parts[2, :, 9:] += path.points_base
    return readonly(parts)


def as_poses(rows: Floats) -> Poses:
    """Return poses (n,) from rows (n, 12), as in ``flange_parts``."""
    return Poses.unchecked(rows[:, :9].reshape(-1, 3, 3), rows[:, 9:])


@dataclass(frozen=True, slots=True, eq=False)
class BranchMargins:
    """Margins of one branch by cause; negative is not allowed (see ``margins``)."""

    qs_rad: Floats  # (n, 6) continuous
    least: Floats  # (n,) of all causes
    singularity: Floats  # (n,) to the nearest of elbow, wrist and shoulder singularity
    limit_deg: Floats  # (n,) of the joint that is nearest to a limit


def joint_path(path: Path5D, model: RobotModel, rolls_rad: ArrayLike, branch: int) -> Floats:
    """Return joint angles (n, 6) along the path for one branch, continuous.

    Args:
        path: The path in ``base``.
        model: The robot with its tool.
        rolls_rad: One roll, or one at each path point (n,).
        branch: Index into ``kinematics.arm.BRANCHES``.
    """
    poses = _poses_on(path, model, rolls_rad)
    blocks = [slice(start, start + AT_ONCE) for start in range(0, max(len(poses), 1), AT_ONCE)]
    only = [
        model.inverse(Poses.unchecked(poses.rotations[some], poses.translations[some]))
        .qs_rad[:, branch : branch + 1]
        .copy()  # so that the postures of the other branches are let go
        for some in blocks
    ]
    return readonly(continuous_branches(np.concatenate(only), model.limits)[:, 0])


def branch_margins(
    path: Path5D, model: RobotModel, rolls_rad: ArrayLike, branch: int
) -> BranchMargins:
    """Return the margins of the ``joint_path`` with the same arguments, against what is allowed."""
    poses, only = _poses_on(path, model, rolls_rad), slice(branch, branch + 1)
    margins = compute_margins(model, poses, MarginLimits(), only)
    qs = margins.qs_rad[:, 0]
    return BranchMargins(
        qs_rad=readonly(qs.copy()),
        least=readonly(margins.least()[:, 0].copy()),
        singularity=readonly(margins.singularity[:, 0].copy()),
        limit_deg=readonly(np.rad2deg(model.limits.clearance_rad(qs).min(axis=1))),
    )


def _poses_on(path: Path5D, model: RobotModel, rolls_rad: ArrayLike) -> Poses:
    rolls = np.broadcast_to(np.asarray(rolls_rad, dtype=np.float64), (len(path),))
    return flange_poses(flange_parts(path, model), rolls)
