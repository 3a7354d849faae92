"""Joint paths that follow a scan path with each roll, and their margins.

Joint paths that follow a scan path, and their margins to limits, singularities and jumps. A margin
is a plain number: the distance from the border of what is allowed, in units of a size that is
comfortable for that quantity. A negative margin is not allowed. See
docs/algorithms/robot/roll_search.md.

Inverse kinematics of a path for every roll of a working set, and the margin of each posture. What
counts here does not depend on the postures before: reach, singularities, and the limits with the
full turns that a joint may make. Arrays are contiguous along the path, which is how the searches
read them. See docs/algorithms/robot/roll_search.md.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.limits import require
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.arm import N_BRANCHES, IkSolutions
from rona_core.robot.kinematics.robot_model import TURN_RAD, JointLimits, RobotModel, shift_to_fit

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
