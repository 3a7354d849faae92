"""Verdicts on varying rolls: the least margin, or how far one leads and why it stops there."""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.robot.kinematics.joint_limits import TURN_RAD
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.infeasibility import (
    FailureCause,
    feasible_verdict,
    find_failure_cause,
    infeasible_verdict,
    posture_at,
)
from rona_core.robot.redundancy.margins import reach_margin, singularity_margin
from rona_core.robot.redundancy.result import RollCurve, RollVerdict
from rona_core.robot.redundancy.roll_grid import RollGrid
from rona_core.robot.redundancy.variable.lattice import band_of
from rona_core.robot.redundancy.variable.optimal_roll import BlockedPath
from rona_core.robot.redundancy.variable.problem import RollProblem

NAME = "varying roll"
SLIGHT = 1e-9  # margin that is missing where a path ends, at least


def variable_roll_verdict(problem: RollProblem, found: RollCurve | BlockedPath) -> RollVerdict:
    """Return the verdict on a varying roll: its least margin, or how far the path is followed."""
    if isinstance(found, RollCurve):
        margins = curve_margins(found, problem.grid)
        index = int(np.argmin(margins))
        roll_deg = float(np.rad2deg(found.rolls_rad[index]))
        turned_deg = float(np.rad2deg(np.ptp(found.rolls_rad)))
        name = f"{NAME} over {turned_deg:.0f}°"
        return feasible_verdict(name, roll_deg, found.branch, float(margins[index]), index)
    if found.spun is not None:
        return _out_of_turns(found.spun, problem.grid)
    return _stopped(problem, found)


def curve_margins(curve: RollCurve, grid: RollGrid) -> Floats:
    """Return the least margin (n,) of a roll curve: reach, singularities, limits and jumps."""
    margin_limits = grid.margin_limits
    solutions = grid.model.inverse(grid.flange_poses(curve.rolls_rad))
    clearance = grid.model.limits.clearance_rad(curve.qs_rad).min(axis=1)
    steps = np.abs(np.diff(curve.qs_rad, axis=0, prepend=curve.qs_rad[:1])).max(axis=1)
    return np.minimum.reduce(
        (
            reach_margin(solutions, margin_limits)[:, curve.branch],
            singularity_margin(solutions, margin_limits)[:, curve.branch],
            clearance / margin_limits.limit_unit_rad,
            (margin_limits.step_rad - steps) / margin_limits.step_unit_rad,
        )
    )


def _out_of_turns(spun: RollCurve, grid: RollGrid) -> RollVerdict:
    """Return the verdict on a curve that keeps every limit but the range of a turning joint."""
    limits, margin_limits = grid.model.limits, grid.margin_limits
    clearance = limits.clearance_rad(spun.qs_rad).min(axis=1)
    index = int(np.argmax(clearance < 0.0))
    solutions = grid.model.inverse(grid.flange_poses(spun.rolls_rad))
    steps = np.diff(spun.qs_rad, axis=0, prepend=spun.qs_rad[:1])
    posture = posture_at(solutions, index, spun.branch, spun.qs_rad[index], steps[index])
    margin = float(clearance.min()) / margin_limits.limit_unit_rad
    roll_deg = float(np.rad2deg(spun.rolls_rad[index]))
    cause = find_failure_cause(posture, limits, margin_limits)
    return infeasible_verdict(
        _name(roll_deg), roll_deg, spun.branch, margin, index, grid.n_points, cause
    )


def _stopped(problem: RollProblem, found: BlockedPath) -> RollVerdict:
    """Return the verdict of the posture with the largest margin next to the last reached ones."""
    grid, index, near = problem.grid, found.furthest + 1, _reachable(problem.grid, found)
    margins = grid.margins[:, :, index]
    shut = np.zeros_like(near) if problem.blocked is None else problem.blocked[index].T
    good = near & (margins >= 0.0)
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
        q = _turned_to_middle(grid.qs_rad[branch, :, roll, index], grid.model, grid.turning)
        posture = posture_at(solutions, index, branch, q, np.zeros(6))
        margin = float(margins[branch, roll])
        cause = find_failure_cause(posture, grid.model.limits, grid.margin_limits)
    return infeasible_verdict(
        _name(roll_deg), roll_deg, branch, min(margin, -SLIGHT), index, grid.n_points, cause
    )


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
        joint = int(np.argmax(np.abs(steps[nearest])))
        value_deg, limit_deg = np.rad2deg((widest, step_rad)).tolist()
        words = f"joint {joint + 1} would jump by {value_deg:.1f}°, {limit_deg:.0f}° are allowed"
        margin = (step_rad - widest) / grid.margin_limits.step_unit_rad
        return margin, FailureCause("jump", joint + 1, value_deg, limit_deg, "deg", words)
    allowed = np.rad2deg(
        float(problem.cost.largest_roll_rad(problem.strides[index - 1 : index])[0])
    )
    wanted = np.rad2deg(grid.spacing_rad)
    words = f"the roll would have to change by {wanted:.1f}°, {allowed:.1f}° are allowed"
    return -1.0, FailureCause("roll rate", 0, float(wanted), float(allowed), "deg", words)


def _turned_to_middle(q_rad: Floats, model: RobotModel, turning: Bools) -> Floats:
    """Return a posture (6,) whose joints with turns stand as near the middle as they can."""
    middle = (model.lower_rad + model.upper_rad) / 2.0
    turns = np.round((middle - q_rad) / TURN_RAD)
    return q_rad + TURN_RAD * np.where(turning, turns, 0.0)


def _name(roll_deg: float) -> str:
    return f"{NAME}, there {roll_deg:.4g}°"
