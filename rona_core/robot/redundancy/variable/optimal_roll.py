"""A roll that varies along the path: the cheapest one on a grid of rolls, over all branches.

Dynamic programming finds the optimum of the stated objective among all sequences of rolls of the
working set that keep every rule. See docs/algorithms/robot/variable_roll.md.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.settings import require
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.joint_limits import JointLimits
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.constant_roll import unwrapped
from rona_core.robot.redundancy.cost import (
    RollCost,
    limit_penalty,
    path_cost,
    strides_of,
    turn_to_suit,
)
from rona_core.robot.redundancy.margins import RoomRules
from rona_core.robot.redundancy.result import RollCurve
from rona_core.robot.redundancy.roll_grid import RollGrid
from rona_core.robot.redundancy.variable.dynamic_program import Way, cheapest, cheapest_within_turns
from rona_core.robot.redundancy.variable.lattice import lattice, open_nodes

MOST_AWARE = 3  # joints whose whole turns are counted at once
EVEN_COST = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class NoWay:
    """How far a varying roll leads where it does not lead through."""

    furthest: int  # last path point that can be reached; -1 if not even the first
    frontier: Bools  # (8, R) postures in which it can be reached
    spun: RollCurve | None  # a way that keeps every rule but the range of a joint with turns


def optimal_roll(
    path: Path5D,
    model: RobotModel,
    grid: RollGrid,
    rules: RoomRules,
    cost: RollCost,
    *,
    blocked: Bools | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RollCurve | NoWay:
    """Return the cheapest roll over the path on a grid, or how far the path can be followed.

    First the whole turns of joints are left out of account. If the way found keeps the limits
    after all and pays no more for them, it is the optimum; otherwise turns are counted for the
    joints concerned, and the search is repeated.

    Args:
        path: The dense path in ``base``.
        model: The robot with its tool.
        grid: Its postures along the path.
        rules: What is allowed.
        cost: The objective, and how fast the roll may change.
        blocked: Postures (n, R, 8) that must not be used, such as those that touch something.
        progress: Told the share that is done.
        cancel: Asked on the way.

    Raises:
        InvalidInputError: ``blocked`` of another shape.
        CancelledError: somebody cancelled.
    """
    shape = (grid.n_points, len(grid.rolls_rad), len(grid.room))
    require(
        blocked is None or blocked.shape == shape,
        f"blocked must have shape {shape}, not {None if blocked is None else blocked.shape}",
    )
    strides, allowed = strides_of(path), open_nodes(grid, blocked)
    branches = np.flatnonzero(allowed.any(axis=1).all(axis=-1))
    aware: tuple[int, ...] = ()
    spun: RollCurve | None = None
    while True:
        costs = lattice(grid, allowed, branches, model.limits, strides, cost, rules, aware)
        if aware:
            way = cheapest_within_turns(
                costs,
                grid,
                aware,
                model.limits,
                strides,
                cost,
                rules,
                progress=progress,
                cancel=cancel,
            )
        else:
            way = cheapest(costs, progress=progress, cancel=cancel)
        if way.branch < 0:
            if spun is None and len(branches) < len(grid.room):
                every = np.arange(len(grid.room))
                whole = lattice(grid, allowed, every, model.limits, strides, cost, rules)
                way = cheapest(whole, progress=progress, cancel=cancel)
            return NoWay(way.furthest, np.isfinite(way.frontier), spun)
        found = curve_of(grid, way, model.limits, strides, cost, rules)
        more = _unpaid(found, grid, way, model.limits, cost, rules) | set(aware)
        if more == set(aware) or len(more) > MOST_AWARE:
            if model.limits.clearance_rad(found.qs_rad).min() >= 0.0:
                return found
            return NoWay(way.furthest, np.isfinite(way.frontier), found)
        spun, aware = found, tuple(sorted(more))


def curve_of(
    grid: RollGrid,
    way: Way,
    limits: JointLimits,
    strides: Floats,
    cost: RollCost,
    rules: RoomRules,
) -> RollCurve:
    """Return the rolls and joints of a way through the lattice, and what it costs."""
    points = np.arange(grid.n_points)
    principal = grid.qs_rad[way.branch][:, way.bins, points]  # (6, n)
    principal[grid.turning] = unwrapped(principal[grid.turning])
    qs, penalties = turn_to_suit(principal.T, limits, grid.turning, rules)
    singular = grid.singular[way.branch, way.bins, points]
    rolls = grid.rolls_rad[way.bins]
    return RollCurve(
        rolls_rad=readonly(np.unwrap(rolls) if grid.closed else rolls),
        branch=way.branch,
        qs_rad=readonly(qs),
        cost=path_cost(qs, penalties, singular, strides, cost),
    )


def constant_curve(
    path: Path5D,
    model: RobotModel,
    grid: RollGrid,
    index: int,
    branch: int,
    rules: RoomRules,
    cost: RollCost,
) -> RollCurve:
    """Return a constant roll of the grid as a curve, with the cost of the same objective."""
    bins = np.full(grid.n_points, index, dtype=np.int64)
    way = Way(0.0, branch, bins, grid.n_points - 1, np.zeros((8, 0)))
    return curve_of(grid, way, model.limits, strides_of(path), cost, rules)


def _unpaid(
    found: RollCurve,
    grid: RollGrid,
    way: Way,
    limits: JointLimits,
    cost: RollCost,
    rules: RoomRules,
) -> set[int]:
    """Return the joints that break their limits, or pay more for them than was counted."""
    points, joints = np.arange(grid.n_points), set[int]()
    for joint in np.flatnonzero(grid.turning).tolist():
        ends = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
        q = found.qs_rad[:, joint]
        principal = grid.qs_rad[way.branch, joint, way.bins, points]
        counted = limit_penalty(principal, *ends, rules, turning=True)
        paid = limit_penalty(q, *ends, rules, turning=False)
        outside = float(q.min()) < ends[0] or float(q.max()) > ends[1]
        if outside or cost.limits * float((paid - counted).max()) > EVEN_COST:
            joints.add(joint)
    return joints
