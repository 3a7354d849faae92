"""Optimal varying roll on a grid of rolls, over all branches, by dynamic programming.

It is the optimum of the stated objective among all sequences of rolls of the working set that
keep every limit. See docs/algorithms/robot/variable_roll.md.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.geometry.arrays import Bools, readonly
from rona_core.robot.redundancy.constant_roll import unwrapped
from rona_core.robot.redundancy.cost import limit_penalty, path_cost, turn_to_suit
from rona_core.robot.redundancy.result import RollCurve
from rona_core.robot.redundancy.variable.dynamic_program import (
    LatticePath,
    cheapest_path,
    cheapest_path_with_turns,
)
from rona_core.robot.redundancy.variable.lattice import build_lattice
from rona_core.robot.redundancy.variable.problem import RollProblem

MOST_AWARE = 3  # joints whose whole turns are counted at once
EVEN_COST = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class BlockedPath:
    """How far a varying roll leads where it does not lead through."""

    furthest: int  # last path point that can be reached; -1 if not even the first
    frontier: Bools  # (8, R) postures in which it can be reached
    spun: RollCurve | None  # a curve that keeps every limit but the range of a joint with turns


def optimal_roll(
    problem: RollProblem, *, progress: Progress = silent, cancel: Cancel = never
) -> RollCurve | BlockedPath:
    """Find the cheapest roll over the path on its grid, or how far the path can be followed.

    First the whole turns of joints are left out of account. If the curve found keeps the limits
    after all and pays no more for them, it is the optimum; otherwise turns are counted for the
    joints concerned, and the search is repeated.

    Raises:
        CancelledError: somebody cancelled.
    """
    n_branches, limits = len(problem.grid.margins), problem.grid.model.limits
    branches = np.flatnonzero(problem.allowed().any(axis=1).all(axis=-1))
    aware: tuple[int, ...] = ()
    spun: RollCurve | None = None
    while True:
        lattice = build_lattice(problem, branches, aware)
        if aware:
            found = cheapest_path_with_turns(
                lattice, problem, aware, progress=progress, cancel=cancel
            )
        else:
            found = cheapest_path(lattice, progress=progress, cancel=cancel)
        if found.branch < 0:
            if spun is None and len(branches) < n_branches:
                whole = build_lattice(problem, np.arange(n_branches))
                found = cheapest_path(whole, progress=progress, cancel=cancel)
            return BlockedPath(found.furthest, np.isfinite(found.frontier), spun)
        curve = curve_of(problem, found)
        more = _unpaid_joints(problem, found, curve) | set(aware)
        if more == set(aware) or len(more) > MOST_AWARE:
            if limits.clearance_rad(curve.qs_rad).min() >= 0.0:
                return curve
            return BlockedPath(found.furthest, np.isfinite(found.frontier), curve)
        spun, aware = curve, tuple(sorted(more))


def curve_of(problem: RollProblem, found: LatticePath) -> RollCurve:
    """Return the rolls and joints of a path through the lattice, and its cost."""
    grid, points = problem.grid, np.arange(problem.grid.n_points)
    principal = grid.qs_rad[found.branch][:, found.bins, points]  # (6, n)
    principal[grid.turning] = unwrapped(principal[grid.turning])
    qs, penalties = turn_to_suit(principal.T, grid.model.limits, grid.turning, grid.margin_limits)
    singularity = grid.singularity[found.branch, found.bins, points]
    rolls = grid.rolls_rad[found.bins]
    return RollCurve(
        rolls_rad=readonly(np.unwrap(rolls) if grid.closed else rolls),
        branch=found.branch,
        qs_rad=readonly(qs),
        cost=path_cost(qs, penalties, singularity, problem.strides, problem.cost),
    )


def _unpaid_joints(problem: RollProblem, found: LatticePath, curve: RollCurve) -> set[int]:
    """Return the joints that break their limits, or pay more for them than was counted."""
    grid, limits = problem.grid, problem.grid.model.limits
    points, joints = np.arange(grid.n_points), set[int]()
    for joint in np.flatnonzero(grid.turning).tolist():
        ends = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
        q = curve.qs_rad[:, joint]
        principal = grid.qs_rad[found.branch, joint, found.bins, points]
        counted = limit_penalty(principal, *ends, grid.margin_limits, turning=True)
        paid = limit_penalty(q, *ends, grid.margin_limits, turning=False)
        outside = float(q.min()) < ends[0] or float(q.max()) > ends[1]
        if outside or problem.cost.limits * float((paid - counted).max()) > EVEN_COST:
            joints.add(joint)
    return joints
