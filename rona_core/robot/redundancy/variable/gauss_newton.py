"""Refine a roll between the bins of the grid: Gauss-Newton that never leaves what is allowed.

The joint angles depend on the roll at the same path point alone, and the cost couples neighbours
only, so that each step solves a tridiagonal system. See docs/algorithms/robot/variable_roll.md.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from rona_core.devices.protocols import Cancel, never
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.joint_limits import TURN_RAD
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.cost import (
    CostShares,
    RollCost,
    path_cost,
    shares_of_points,
    strides_of,
)
from rona_core.robot.redundancy.margins import RoomRules, singular_room
from rona_core.robot.redundancy.result import RollCurve
from rona_core.robot.redundancy.roll_grid import (
    RollGrid,
    flange_parts,
    follow_poses,
    reach_room,
    turning_joints,
)

MOST_STEPS = 25
LEAST_GAIN = 1e-4  # of the cost; less is not worth another step
NUDGE_RAD = 1e-4  # of the roll, for derivatives
SHORTEST = 1.0 / 64.0  # of a step that is tried
STILL_RAD = 1e-3  # joint travel of a step below which its root is treated as a square
DAMPING = 1e-3  # of the diagonal
EXACT_RAD = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class _Posture:
    """What the arm does at n path points for given rolls, on one branch."""

    qs_rad: Floats  # (n, 6) near those before
    reach: Floats  # (n,) room
    singular: Floats  # (n,) room
    limits: Floats  # (n, 6) room of each joint


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """The path, the arm and the rules; nothing that changes from step to step."""

    parts: Floats
    model: RobotModel
    branch: int
    turning: Bools
    strides: Floats
    rules: RoomRules
    cost: RollCost

    def posture(self, rolls_rad: Floats, near_rad: Floats) -> _Posture:
        """Return the posture for rolls (n,), its whole turns those nearest to ``near_rad``."""
        solutions = self.model.inverse(follow_poses(self.parts, rolls_rad))
        qs = solutions.qs_rad[:, self.branch].copy()
        turns = np.round((near_rad - qs) / TURN_RAD)
        qs += TURN_RAD * np.where(self.turning, turns, 0.0)
        return _Posture(
            qs_rad=qs,
            reach=reach_room(solutions, self.rules)[:, self.branch],
            singular=singular_room(solutions, self.rules)[:, self.branch],
            limits=self.model.limits.clearance_rad(qs) / self.rules.limit_unit_rad,
        )

    def price(self, posture: _Posture) -> CostShares:
        """Return the cost of a posture all along the path."""
        penalties = _short(posture.limits) ** 2
        return path_cost(posture.qs_rad, penalties, posture.singular, self.strides, self.cost)

    def keeps_rules(self, rolls_rad: Floats, posture: _Posture) -> bool:
        """Return whether every point and every step is allowed."""
        steps = np.abs(np.diff(posture.qs_rad, axis=0)).max(initial=0.0)
        turns = np.abs(np.diff(rolls_rad)) - self.cost.largest_roll_rad(self.strides)
        least = min(posture.reach.min(), posture.singular.min(), posture.limits.min())
        return bool(
            least >= 0.0 and steps <= self.rules.step_rad and turns.max(initial=0.0) <= EXACT_RAD
        )


def refine_roll(
    path: Path5D,
    model: RobotModel,
    grid: RollGrid,
    start: RollCurve,
    rules: RoomRules,
    cost: RollCost,
    *,
    blocked: Bools | None = None,
    cancel: Cancel = never,
) -> RollCurve:
    """Return a roll curve that costs no more than ``start`` and keeps the same rules.

    Args:
        path: The dense path in ``base``.
        model: The robot with its tool.
        grid: The grid that ``start`` was found on.
        start: A roll curve that keeps the rules.
        rules: What is allowed.
        cost: The objective.
        blocked: Postures (n, R, 8) of the grid that must not be used; a roll between two bins
            counts as blocked where one of them is.
        cancel: Asked between steps.

    Raises:
        CancelledError: somebody cancelled.
    """
    if len(path) < 2:
        return start
    problem = _Problem(
        parts=flange_parts(path, model),
        model=model,
        branch=start.branch,
        turning=turning_joints(model.limits),
        strides=strides_of(path),
        rules=rules,
        cost=cost,
    )
    lower, upper = _free_range(grid, start, blocked)
    rolls = start.rolls_rad.copy()
    now = problem.posture(rolls, start.qs_rad)
    price = problem.price(now)
    if not problem.keeps_rules(rolls, now):  # on the very edge: rounding decides
        return start
    for _ in range(MOST_STEPS):
        if cancel():
            raise CancelledError("the refinement of the roll was cancelled")
        step = _newton_step(problem, rolls, now, lower, upper)
        share, gained = 1.0, 0.0
        while share >= SHORTEST:
            trial = np.clip(rolls + share * step, lower, upper)
            there = problem.posture(trial, now.qs_rad)
            cheaper = problem.price(there)
            if cheaper.total < price.total and problem.keeps_rules(trial, there):
                gained = price.total - cheaper.total
                rolls, now, price = trial, there, cheaper
                break
            share /= 2.0
        if gained < LEAST_GAIN * price.total:
            break
    if price.total >= start.cost.total:
        return start
    return RollCurve(readonly(rolls), start.branch, readonly(now.qs_rad), price)


def _free_range(grid: RollGrid, start: RollCurve, blocked: Bools | None) -> tuple[Floats, Floats]:
    """Return the rolls (n,) between which all bins about that of ``start`` are allowed."""
    open_bins = grid.room[start.branch].T >= 0.0  # (n, R)
    if blocked is not None:
        open_bins &= ~blocked[:, :, start.branch]
    n, count = open_bins.shape
    spacing = grid.spacing_rad
    bins = np.round((start.rolls_rad - grid.rolls_rad[0]) / spacing).astype(np.int64)
    lower, upper = start.rolls_rad.copy(), start.rolls_rad.copy()
    for ends, side in ((lower, -1), (upper, 1)):
        going = np.ones(n, dtype=np.bool_)
        for away in range(1, count if grid.closed else count + 1):
            there = bins + side * away
            inside = np.ones(n, np.bool_) if grid.closed else (there >= 0) & (there < count)
            going &= inside & open_bins[np.arange(n), there % count]
            if not going.any():
                break
            ends[going] += side * spacing
    return lower, upper


def _newton_step(
    problem: _Problem, rolls: Floats, now: _Posture, lower: Floats, upper: Floats
) -> Floats:
    """Return the Gauss-Newton step (n,) of the rolls, zero where a bound is in the way."""
    cost, strides = problem.cost, problem.strides
    ahead = problem.posture(rolls + NUDGE_RAD, now.qs_rad)
    back = problem.posture(rolls - NUDGE_RAD, now.qs_rad)
    weights = np.array(cost.joint_weights)
    rate = (ahead.qs_rad - back.qs_rad) * weights / (2.0 * NUDGE_RAD)  # (n, 6) per radian of roll
    change = np.diff(now.qs_rad, axis=0) * weights
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
    for part, before, after, price in (
        (now.limits, back.limits, ahead.limits, cost.limits),
        (
            now.singular[:, None],
            back.singular[:, None],
            ahead.singular[:, None],
            cost.singularities,
        ),
    ):
        short = _short(part)
        slope = np.where(short > 0.0, (before - after) / (2.0 * NUDGE_RAD), 0.0)
        gradient += 2.0 * price * share * (short * slope).sum(axis=1)
        diagonal += 2.0 * price * share * (slope**2).sum(axis=1)
    held = ((rolls <= lower) & (gradient > 0.0)) | ((rolls >= upper) & (gradient < 0.0))
    diagonal = diagonal * (1.0 + DAMPING) + 1e-9
    diagonal[held] = 1.0
    gradient[held] = 0.0
    beside[held[1:] | held[:-1]] = 0.0
    return solveh_banded(
        np.vstack((np.concatenate(([0.0], beside)), diagonal)), -gradient, check_finite=False
    )


def _short(room: Floats) -> Floats:
    """Return what room lacks to be comfortable."""
    return np.maximum(0.0, 1.0 - room)
