"""Planning of a varying roll: optimum on the grid, refined, clear of obstacles.

Gauss-Newton refinement of a roll between the bins of the grid, within what is allowed. The joint
angles depend on the roll at the same path point alone, and the cost couples neighbours only, so
that each step solves a tridiagonal system. See docs/algorithms/robot/variable_roll.md.
"""

import numpy as np
from scipy.linalg import solveh_banded

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.redundancy.infeasibility import still_touches, variable_roll_verdict
from rona_core.robot.redundancy.margins import (
    RollGrid,
    RollPostures,
    flange_poses,
    limit_margin,
    reach_margin,
    solve_roll_grid,
)
from rona_core.robot.redundancy.optimal_roll import BlockedPath, RollProblem, optimal_roll
from rona_core.robot.redundancy.result import (
    CostShares,
    RollCost,
    RollCurve,
    RollVerdict,
    hinge,
    path_cost,
    shares_of_points,
)

MOST_STEPS = 25
LEAST_GAIN = 1e-4  # of the cost; less is not worth another step
NUDGE_RAD = 1e-4  # of the roll, for derivatives
SHORTEST = 1.0 / 64.0  # of a step that is tried
STILL_RAD = 1e-3  # joint travel of a step below which its root is treated as a square
DAMPING = 1e-3  # of the diagonal
EXACT_RAD = 1e-9


def refine_roll(problem: RollProblem, start: RollCurve, *, cancel: Cancel = never) -> RollCurve:
    """Refine a roll curve that keeps every limit; it never costs more than ``start``.

    A roll between two bins of the grid counts as blocked where one of them is.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    if problem.grid.n_points < 2:
        return start
    grid, branch = problem.grid, start.branch
    lower, upper = _free_range(problem, start)
    rolls = start.rolls_rad.copy()
    posture = grid.postures(branch, rolls, start.qs_rad)
    cost = _cost(problem, posture)
    if not _keeps_limits(problem, rolls, posture):  # on the very edge: rounding decides
        return start
    for _ in range(MOST_STEPS):
        if cancel():
            raise CancelledError("the refinement of the roll was cancelled")
        around = [
            grid.postures(branch, rolls + nudge, posture.qs_rad)
            for nudge in (-NUDGE_RAD, NUDGE_RAD)
        ]
        step = _newton_step(problem, rolls, posture, (around[0], around[1]), (lower, upper))
        share, gained = 1.0, 0.0
        while share >= SHORTEST:
            trial = np.clip(rolls + share * step, lower, upper)
            trial_posture = grid.postures(branch, trial, posture.qs_rad)
            trial_cost = _cost(problem, trial_posture)
            if trial_cost.total < cost.total and _keeps_limits(problem, trial, trial_posture):
                gained = cost.total - trial_cost.total
                rolls, posture, cost = trial, trial_posture, trial_cost
                break
            share /= 2.0
        if gained < LEAST_GAIN * cost.total:
            break
    if cost.total >= start.cost.total:
        return start
    return RollCurve(readonly(rolls), start.branch, readonly(posture.qs_rad), cost)


def _cost(problem: RollProblem, postures: RollPostures) -> CostShares:
    return path_cost(
        postures.qs_rad,
        hinge(postures.limits),
        postures.singularity,
        problem.strides,
        problem.cost,
    )


def _keeps_limits(problem: RollProblem, rolls_rad: Floats, postures: RollPostures) -> bool:
    """Return whether every point and every step is allowed."""
    steps = np.abs(np.diff(postures.qs_rad, axis=0)).max(initial=0.0)
    turns = np.abs(np.diff(rolls_rad)) - problem.cost.largest_roll_rad(problem.strides)
    least = min(postures.reach.min(), postures.singularity.min(), postures.limits.min())
    return bool(
        least >= 0.0
        and steps <= problem.grid.margin_limits.step_rad
        and turns.max(initial=0.0) <= EXACT_RAD
    )


def _free_range(problem: RollProblem, start: RollCurve) -> tuple[Floats, Floats]:
    """Return the rolls (n,) between which all bins about that of ``start`` are allowed."""
    grid = problem.grid
    open_bins = problem.allowed()[start.branch].T  # (n, R)
    n, count = open_bins.shape
    bins = problem.bins_of(start.rolls_rad)
    lower, upper = start.rolls_rad.copy(), start.rolls_rad.copy()
    for ends, side in ((lower, -1), (upper, 1)):
        going = np.ones(n, dtype=np.bool_)
        for distance in range(1, count if grid.closed else count + 1):
            beside = bins + side * distance
            inside = np.ones(n, np.bool_) if grid.closed else (beside >= 0) & (beside < count)
            going &= inside & open_bins[np.arange(n), beside % count]
            if not going.any():
                break
            ends[going] += side * grid.spacing_rad
    return lower, upper


def _newton_step(
    problem: RollProblem,
    rolls: Floats,
    posture: RollPostures,
    around: tuple[RollPostures, RollPostures],
    bounds: tuple[Floats, Floats],
) -> Floats:
    """Return the Gauss-Newton step (n,) of the rolls, zero where a bound is in the way.

    The objective is a sum of squares of residuals r(roll); the step solves the tridiagonal system
    (J^T W J) step = -J^T W r with J = dr / droll by central differences.

    Args:
        problem: The path and the objective.
        rolls: The present rolls (n,).
        posture: The posture for them.
        around: The postures for rolls ``NUDGE_RAD`` less and more.
        bounds: Lower and upper bounds (n,) of the rolls.
    """
    cost, strides = problem.cost, problem.strides
    (back, ahead), (lower, upper) = around, bounds
    weights = np.array(cost.joint_weights)
    rate = (ahead.qs_rad - back.qs_rad) * weights / (2.0 * NUDGE_RAD)  # (n, 6) per radian of roll
    change = np.diff(posture.qs_rad, axis=0) * weights
    size = np.maximum(np.linalg.norm(change, axis=1), STILL_RAD)
    weight = cost.travel / size + 2.0 * cost.evenness / np.maximum(strides, 0.05)
    pull = weight[:, None] * change
    gradient = np.zeros(len(rolls))
    gradient[1:] += np.einsum("ij,ij->i", rate[1:], pull)
    gradient[:-1] -= np.einsum("ij,ij->i", rate[:-1], pull)
    squares = np.einsum("ij,ij->i", rate, rate)
    diagonal = np.zeros(len(rolls))
    diagonal[1:] += weight * squares[1:]
    diagonal[:-1] += weight * squares[:-1]
    beside = -weight * np.einsum("ij,ij->i", rate[1:], rate[:-1])
    share = shares_of_points(strides)
    for name, weight_of_margin in (("limits", cost.limits), ("singularity", cost.singularities)):
        margin, before, after = (
            getattr(p, name).reshape(len(rolls), -1) for p in (posture, back, ahead)
        )
        shortfall = np.maximum(0.0, 1.0 - margin)
        slope = np.where(shortfall > 0.0, (before - after) / (2.0 * NUDGE_RAD), 0.0)
        gradient += 2.0 * weight_of_margin * share * (shortfall * slope).sum(axis=1)
        diagonal += 2.0 * weight_of_margin * share * (slope**2).sum(axis=1)
    at_bound = ((rolls <= lower) & (gradient > 0.0)) | ((rolls >= upper) & (gradient < 0.0))
    diagonal = diagonal * (1.0 + DAMPING) + 1e-9
    diagonal[at_bound] = 1.0
    gradient[at_bound] = 0.0
    beside[at_bound[1:] | at_bound[:-1]] = 0.0
    bands = np.vstack((np.concatenate(([0.0], beside)), diagonal))
    return np.asarray(solveh_banded(bands, -gradient, check_finite=False))


WIDEST_RAD = np.deg2rad(5.0) + 1e-9  # between rolls through which a varying one is searched
MOST_DETOURS = 12  # searches round what was found to touch something
MOST_POINTS = 32  # path points whose postures are all checked in one go
DETOUR_SHARE = 0.5  # of what is left of the progress


def plan_variable_roll(
    grid: RollGrid,
    cost: RollCost,
    *,
    clear: Clear | None = None,
    standoff_mm: float = 0.0,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> tuple[RollCurve | None, RollVerdict]:
    """Plan the cheapest roll that varies along the path, refined, and give the verdict on it.

    It never costs more than the cheapest constant roll of the set that keeps the same limits, in
    the same objective. Rolls that are more than 5 degrees apart get others in between.

    Args:
        grid: The rolls of the working set along the path.
        cost: The objective.
        clear: Maps joint angles (m, 6) to where nothing is touched. The curve found is checked,
            and searched anew round the postures that touch.
        standoff_mm: The probe must be able to be retracted this far from both ends.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked on the way.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    rolls_rad = refined_rolls(grid)
    if len(rolls_rad) != len(grid.rolls_rad):
        grid = solve_roll_grid(grid.path, grid.model, rolls_rad, grid.margin_limits, cancel=cancel)
    problem = RollProblem(grid, cost)
    if standoff_mm > 0.0:
        blocked = problem.blocked.copy()
        blocked[[0, -1]] |= blocked_retracts(grid, standoff_mm)
        problem = problem.with_blocked(blocked)
    done, detours = 0.0, 0
    while True:
        found = optimal_roll(
            problem,
            progress=lambda share, done=done: progress(done + (1 - done) * DETOUR_SHARE * share),
            cancel=cancel,
        )
        if isinstance(found, BlockedPath):
            return None, variable_roll_verdict(problem, found)
        refined = refine_roll(problem, found, cancel=cancel)
        if clear is None or clear(refined.qs_rad).all():
            return refined, variable_roll_verdict(problem, refined)
        touched = np.flatnonzero(~clear(found.qs_rad))
        if not len(touched):  # what is finer than the grid came too near
            return found, variable_roll_verdict(problem, found)
        if detours == MOST_DETOURS:
            return None, still_touches(found, touched, MOST_DETOURS)
        detours += 1
        problem = _around_collisions(problem, found, touched, clear)
        done += (1.0 - done) * DETOUR_SHARE


def refined_rolls(grid: RollGrid) -> Floats:
    """Return the rolls (R,) of a grid, with others in between if neighbours are too far apart."""
    pieces = int(np.ceil(grid.spacing_rad / WIDEST_RAD)) if len(grid.rolls_rad) > 1 else 1
    if pieces == 1:
        return grid.rolls_rad
    count = len(grid.rolls_rad) * pieces - (0 if grid.closed else pieces - 1)
    return grid.rolls_rad[0] + grid.spacing_rad / pieces * np.arange(count)


def blocked_retracts(grid: RollGrid, standoff_mm: float) -> Bools:
    """Return the postures (2, R, 8) at both ends from which the probe cannot be retracted.

    Args:
        grid: Postures along the path.
        standoff_mm: How far it has to be retracted along its axis.
    """
    ends, n_rolls, model = [0, grid.n_points - 1], len(grid.rolls_rad), grid.model
    parts = grid.flange_parts[:, ends]
    parts[2, :, 9:] -= standoff_mm * grid.path.axes_base[ends]
    result = np.zeros((2, n_rolls, len(grid.margins)), dtype=np.bool_)
    for end in range(2):
        parts_at_end = np.repeat(parts[:, end : end + 1], n_rolls, axis=1)
        solutions = model.inverse(flange_poses(parts_at_end, grid.rolls_rad))
        angles = solutions.qs_rad.transpose(2, 0, 1)
        limit = limit_margin(angles, model.limits, grid.turning, grid.margin_limits)
        result[end] = np.minimum(limit, reach_margin(solutions, grid.margin_limits)) < 0.0
    return result


def _around_collisions(
    problem: RollProblem, found: RollCurve, touched: Ints, clear: Clear
) -> RollProblem:
    """Return the problem with what touches at some path points (k,) of a curve blocked.

    Of many points some are checked, spread evenly, and stand for their neighbours. Postures that
    are not allowed anyway are not checked.
    """
    grid, blocked, allowed = problem.grid, problem.blocked.copy(), problem.allowed()
    most = np.linspace(0, len(touched) - 1, min(MOST_POINTS, len(touched)))
    some = touched[np.unique(most.astype(np.int64))]
    touches = np.zeros((len(some), *grid.shape[1:]), dtype=np.bool_)
    for row, point in enumerate(some):
        branch, roll = np.nonzero(allowed[:, :, point])
        if len(branch):
            touches[row, roll, branch] = ~clear(grid.qs_rad[branch, :, roll, point])
    blocked[touched] |= touches[np.abs(touched[:, None] - some).argmin(axis=1)]
    bins = problem.bins_of(found.rolls_rad)[touched] % len(grid.rolls_rad)
    blocked[touched, bins, found.branch] = True
    return problem.with_blocked(blocked)
