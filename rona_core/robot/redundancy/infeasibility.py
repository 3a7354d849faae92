"""Verdicts on constant and varying rolls: the least margin, or what fails first and why."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.robot.kinematics.arm import IkSolutions
from rona_core.robot.kinematics.robot_model import TURN_RAD, JointLimits
from rona_core.robot.redundancy.margins import ROUNDED_MM, MarginLimits, RollGrid
from rona_core.robot.redundancy.optimal_roll import BlockedPath, RollProblem, band_of
from rona_core.robot.redundancy.result import Reason, RollCurve, RollVerdict

NAME = "varying roll"
SLIGHT = 1e-9  # margin that is missing where a path ends, at least


@dataclass(frozen=True, slots=True)
class FailureCause:
    """Why a posture fails: the joint (1 to 6, 0 for none), its value and what is allowed."""

    reason: Reason
    joint: int
    value: float
    limit: float
    unit: str
    words: str


def verdict_on(
    roll_deg: float,
    branch: int,
    margin: float,
    index: int,
    n: int,
    cause: FailureCause | None = None,
    name: str = "",
) -> RollVerdict:
    """Return the verdict on a roll.

    Args:
        roll_deg: The roll.
        branch: Of the arm.
        margin: Least margin along the path.
        index: Path point that fails first; that with the least margin where none does.
        n: Number of path points.
        cause: Why it fails; None: the whole path can be followed.
        name: What the roll is called; by default its angle.
    """
    name = name or f"roll {roll_deg:.4g}°"
    if cause is None:
        words = f"the whole path can be followed, smallest margin {margin:.2f}"
        cause = FailureCause("none", 0, margin, 0.0, "", words)
    place = "" if cause.reason in ("none", "no way") else f" at path point {index} of {n}"
    return RollVerdict(
        roll_deg=roll_deg,
        feasible=cause.reason == "none",
        branch=branch,
        margin=margin,
        reason=cause.reason,
        index=index,
        joint=cause.joint,
        value=cause.value,
        limit=cause.limit,
        unit=cause.unit,
        sentence=f"{name}: {cause.words}{place}",
    )


def find_failure_cause(
    solutions: IkSolutions,
    place: tuple[int, int],
    q_rad: Floats,
    step_rad: Floats,
    limits: JointLimits,
    margin_limits: MarginLimits,
) -> FailureCause:
    """Find why a posture fails: reach, then singularities, then limits, then a jump.

    Args:
        solutions: Solved poses, that of the posture among them.
        place: Its pose and its branch among these.
        q_rad: Its continuous joint angles (6,).
        step_rad: The step (6,) from the path point before.
        limits: Of the joints.
        margin_limits: What else is allowed.
    """
    if not solutions.valid[place]:
        return _reach(float(solutions.reaches_mm[place]))
    elbow, wrist = float(solutions.sin_elbows[place]), float(solutions.sin_wrist[place])
    out_mm = float(solutions.wrist_distance_mm[place[0]])
    return (
        _singularity(elbow, wrist, out_mm, margin_limits)
        or _limit(q_rad, limits)
        or _jump(step_rad, margin_limits)
    )


def _reach(reach_mm: float) -> FailureCause:
    outside_mm = max(ROUNDED_MM, -reach_mm)
    words = f"the wrist would have to be {outside_mm:.3g} mm outside the reach of the arm"
    return FailureCause("reach", 0, -outside_mm, 0.0, "mm", words)


def _singularity(
    sin_elbow: float, sin_wrist: float, out_mm: float, margin_limits: MarginLimits
) -> FailureCause | None:
    least_deg = float(np.rad2deg(margin_limits.singular_rad))
    for joint, name, sine in ((3, "the elbow", sin_elbow), (5, "joint 5", sin_wrist)):
        if sine < np.sin(margin_limits.singular_rad):
            angle_deg = float(np.rad2deg(np.arcsin(min(1.0, sine))))
            words = f"{name} is {angle_deg:.1f}° from straight, {least_deg:.0f}° are needed"
            return FailureCause("singularity", joint, angle_deg, least_deg, "deg", words)
    if out_mm >= margin_limits.shoulder_mm:
        return None
    words = (
        f"the wrist is {out_mm:.0f} mm from axis 1, {margin_limits.shoulder_mm:.0f} mm are needed"
    )
    return FailureCause("singularity", 1, out_mm, margin_limits.shoulder_mm, "mm", words)


def _limit(q: Floats, limits: JointLimits) -> FailureCause | None:
    clearance = limits.clearance_rad(q)
    joint = int(np.argmin(clearance))
    if clearance[joint] >= 0.0:
        return None
    below = q[joint] < limits.lower_rad[joint]
    bound = limits.lower_rad[joint] if below else limits.upper_rad[joint]
    value_deg, limit_deg = float(np.rad2deg(q[joint])), float(np.rad2deg(bound))
    words = f"joint {joint + 1} would be at {value_deg:.1f}°, its limit is {limit_deg:.1f}°"
    return FailureCause("limit", joint + 1, value_deg, limit_deg, "deg", words)


def _jump(step_rad: Floats, margin_limits: MarginLimits) -> FailureCause:
    joint = int(np.argmax(np.abs(step_rad)))
    value_deg, limit_deg = np.rad2deg((abs(step_rad[joint]), margin_limits.step_rad)).tolist()
    words = f"joint {joint + 1} would jump by {value_deg:.1f}°, {limit_deg:.0f}° are allowed"
    return FailureCause("jump", joint + 1, value_deg, limit_deg, "deg", words)


def variable_roll_verdict(problem: RollProblem, found: RollCurve | BlockedPath) -> RollVerdict:
    """Return the verdict on a varying roll: its least margin, or how far the path is followed."""
    if isinstance(found, RollCurve):
        margins = curve_margins(found, problem.grid)
        index = int(np.argmin(margins))
        roll_deg = float(np.rad2deg(found.rolls_rad[index]))
        turned_deg = float(np.rad2deg(np.ptp(found.rolls_rad)))
        name = f"{NAME} over {turned_deg:.0f}°"
        n, margin = len(margins), float(margins[index])
        return verdict_on(roll_deg, found.branch, margin, index, n, name=name)
    if found.spun is not None:
        return _out_of_turns(found.spun, problem.grid)
    return _stopped(problem, found)


def curve_margins(curve: RollCurve, grid: RollGrid) -> Floats:
    """Return the least margin (n,) of a roll curve: reach, singularities, limits and jumps."""
    margin_limits = grid.margin_limits
    postures = grid.postures(curve.branch, curve.rolls_rad, curve.qs_rad)
    steps = np.abs(np.diff(curve.qs_rad, axis=0, prepend=curve.qs_rad[:1])).max(axis=1)
    jump = (margin_limits.step_rad - steps) / margin_limits.step_unit_rad
    return np.minimum.reduce(
        (postures.reach, postures.singularity, postures.limits.min(axis=1), jump)
    )


def _out_of_turns(spun: RollCurve, grid: RollGrid) -> RollVerdict:
    """Return the verdict on a curve that keeps every limit but the range of a turning joint."""
    limits, margin_limits = grid.model.limits, grid.margin_limits
    clearance = limits.clearance_rad(spun.qs_rad).min(axis=1)
    index = int(np.argmax(clearance < 0.0))
    solutions = grid.model.inverse(grid.flange_poses(spun.rolls_rad))
    steps = np.diff(spun.qs_rad, axis=0, prepend=spun.qs_rad[:1])
    margin = float(clearance.min()) / margin_limits.limit_unit_rad
    roll_deg = float(np.rad2deg(spun.rolls_rad[index]))
    cause = find_failure_cause(
        solutions, (index, spun.branch), spun.qs_rad[index], steps[index], limits, margin_limits
    )
    return _failing(roll_deg, spun.branch, margin, index, grid.n_points, cause)


def _stopped(problem: RollProblem, found: BlockedPath) -> RollVerdict:
    """Return the verdict of the posture with the largest margin next to the last reached ones."""
    grid, index, near = problem.grid, found.furthest + 1, _reachable(problem.grid, found)
    margins = grid.margins[:, :, index]
    shut, good = problem.blocked[index].T, near & (margins >= 0.0)
    free, barred = good & ~shut, good & shut
    pool = free if free.any() else barred if barred.any() else near
    best = np.unravel_index(int(np.argmax(np.where(pool, margins, -np.inf))), margins.shape)
    branch, roll = int(best[0]), int(best[1])
    roll_deg = float(np.rad2deg(grid.rolls_rad[roll]))
    if free.any() and index:
        margin, cause = _step_cause(problem, found, (branch, roll, index))
    elif barred.any():
        count = int(barred.sum())
        words = f"all {count} postures that the arm allows touch something or cannot be left"
        margin, cause = 0.0, FailureCause("blocked", 0, float(count), 0.0, "", words)
    else:
        rolls = np.full(grid.n_points, grid.rolls_rad[roll])
        solutions = grid.model.inverse(grid.flange_poses(rolls))
        q = grid.qs_rad[branch, :, roll, index]
        middle = (grid.model.lower_rad + grid.model.upper_rad) / 2.0
        turns = np.where(grid.turning, np.round((middle - q) / TURN_RAD), 0.0)
        q = q + TURN_RAD * turns  # as near the middle of the limits as can be
        margin = float(margins[branch, roll])
        cause = find_failure_cause(
            solutions, (index, branch), q, np.zeros(6), grid.model.limits, grid.margin_limits
        )
    return _failing(roll_deg, branch, min(margin, -SLIGHT), index, grid.n_points, cause)


def _reachable(grid: RollGrid, found: BlockedPath) -> Bools:
    """Return the postures (8, R) within the band of those reached at the point before."""
    if found.furthest < 0:
        return np.ones_like(found.frontier)
    near, count, band = found.frontier.copy(), len(grid.rolls_rad), band_of(grid)
    for shift in range(-band, band + 1):
        moved = np.roll(found.frontier, shift, axis=1)
        if not grid.closed and shift:
            moved[:, : max(0, shift)] = False
            moved[:, count + min(0, shift) :] = False
        near |= moved
    return near


def _step_cause(
    problem: RollProblem, found: BlockedPath, place: tuple[int, int, int]
) -> tuple[float, FailureCause]:
    """Return margin and cause of the step to a posture that is allowed by itself."""
    grid, step_rad = problem.grid, problem.grid.margin_limits.step_rad
    branch, roll, index = place
    before = np.flatnonzero(found.frontier[branch])
    steps = grid.qs_rad[branch, :, roll, index] - grid.qs_rad[branch][:, before, index - 1].T
    steps -= TURN_RAD * np.where(grid.turning, np.round(steps / TURN_RAD), 0.0)
    nearest = int(np.argmin(np.abs(steps).max(axis=1)))
    widest = float(np.abs(steps[nearest]).max())
    if widest > step_rad:
        margin = (step_rad - widest) / grid.margin_limits.step_unit_rad
        return margin, _jump(steps[nearest], grid.margin_limits)
    allowed = np.rad2deg(
        float(problem.cost.largest_roll_rad(problem.strides[index - 1 : index])[0])
    )
    wanted = np.rad2deg(grid.spacing_rad)
    words = f"the roll would have to change by {wanted:.1f}°, {allowed:.1f}° are allowed"
    return -1.0, FailureCause("roll rate", 0, float(wanted), float(allowed), "deg", words)


def _failing(
    roll_deg: float, branch: int, margin: float, index: int, n: int, cause: FailureCause
) -> RollVerdict:
    name = f"{NAME}, there {roll_deg:.4g}°"
    return verdict_on(roll_deg, branch, margin, index, n, cause, name)


def still_touches(curve: RollCurve, touched: Ints, n_detours: int) -> RollVerdict:
    """Return the verdict on a curve that could not be led round all that it touches at (k,)."""
    index, n = int(touched[0]), len(curve.rolls_rad)
    words = f"{n_detours} detours leave {len(touched)} points where the arm touches, first"
    cause = FailureCause("blocked", 0, float(len(touched)), 0.0, "", words)
    roll_deg = float(np.rad2deg(curve.rolls_rad[index]))
    return _failing(roll_deg, curve.branch, -SLIGHT, index, n, cause)
