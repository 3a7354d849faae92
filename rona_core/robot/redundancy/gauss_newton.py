"""Gauss-Newton refinement of a roll between the bins of the grid, within what is allowed.

The joint angles depend on the roll at the same path point alone, and the cost couples neighbours
only, so that each step solves a tridiagonal system. See docs/algorithms/robot/variable_roll.md.
"""

import numpy as np
from scipy.linalg import solveh_banded

from rona_core.devices.protocols import Cancel, never
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.robot.redundancy.cost import CostShares, hinge, path_cost, shares_of_points
from rona_core.robot.redundancy.lattice import RollProblem
from rona_core.robot.redundancy.result import RollCurve
from rona_core.robot.redundancy.roll_grid import RollPostures

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
    return solveh_banded(
        np.vstack((np.concatenate(([0.0], beside)), diagonal)), -gradient, check_finite=False
    )
