"""Optimal varying roll on a grid of rolls, over all branches, by dynamic programming.

It is the optimum of the stated objective among all sequences of rolls of the working set that
keep every limit. Bellman's recursion over the path points k, with the costs N of postures and S of
steps of the lattice (a ladder graph, Maeyer 2017):
V[k + 1, r] = min over o of (V[k, r + o - K] + S[k, o, r]) + N[k + 1, r].
See docs/algorithms/robot/variable_roll.md.

Lattice of a varying roll: the cost of each posture and of each small step along a path. Steps join
postures of the same branch at neighbouring path points whose rolls differ by a few bins at most.
What is not allowed costs infinity.
"""

import itertools
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.robot.kinematics.arm import N_BRANCHES
from rona_core.robot.kinematics.robot_model import TURN_RAD, JointLimits
from rona_core.robot.redundancy.margins import EVEN_DIGITS, RollGrid
from rona_core.robot.redundancy.result import (
    RollCost,
    RollCurve,
    hinge,
    limit_penalty,
    path_cost,
    shares_of_points,
    strides_of,
    turn_to_suit,
)

BAND = 2  # bins that the roll may change by from one path point to the next
PIECE = 256  # path points worked on together, so that intermediate arrays stay in the cache
ROUNDING_RAD = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class RollProblem:
    """What a varying roll is searched in: postures, objective and what is blocked."""

    grid: RollGrid  # postures along the path, and what is allowed
    cost: RollCost  # the objective, and how fast the roll may change
    blocked: Bools = field(default_factory=lambda: np.zeros((1, 1, 1), dtype=np.bool_))
    strides: Floats = field(init=False)  # (n - 1,) of each step along the path

    def __post_init__(self) -> None:
        # (n, R, 8) postures that must not be used, as those that touch something
        object.__setattr__(self, "blocked", np.broadcast_to(self.blocked, self.grid.shape))
        object.__setattr__(self, "strides", strides_of(self.grid.path))

    def allowed(self) -> Bools:
        """Return which postures (8, R, n) are allowed by themselves."""
        return (self.grid.margins >= 0.0) & ~self.blocked.transpose(2, 1, 0)

    def bins_of(self, rolls_rad: Floats) -> Ints:
        """Return the bins (n,) of the grid that are nearest to rolls (n,), whole turns included."""
        off = (rolls_rad - self.grid.rolls_rad[0]) / self.grid.spacing_rad
        return np.round(off).astype(np.int64)

    def with_blocked(self, blocked: Bools) -> "RollProblem":
        """Return the problem with other postures blocked."""
        return replace(self, blocked=blocked)


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Costs of B branches over n path points and R rolls; 2 K + 1 steps lead to each posture.

    Step ``o`` leads to bin r from bin r + o - K.
    """

    branches: Ints  # (B,) of the arm
    nodes: Floats  # (n, B, R) infinite where the posture is not allowed
    steps: Floats  # (n - 1, B, 2 K + 1, R)
    band: int  # K
    aware: tuple[int, ...]  # joints whose limits are left out, to be kept with whole turns counted


def band_of(grid: RollGrid) -> int:
    """Return K: how many bins the roll may change by at once."""
    count = len(grid.rolls_rad)
    return min(BAND, (count - 1) // 2 if grid.closed else count - 1)


def build_lattice(problem: RollProblem, branches: Ints, aware: tuple[int, ...] = ()) -> Lattice:
    """Return the costs of some branches; the limits of joints in ``aware`` are left out."""
    grid, cost = problem.grid, problem.cost
    n, count, band = grid.n_points, len(grid.rolls_rad), band_of(grid)
    nodes = np.zeros((n, len(branches), count))
    steps = np.zeros((max(0, n - 1), len(branches), 2 * band + 1, count))
    strides, allowed = problem.strides, problem.allowed()
    share = shares_of_points(strides)
    for i, branch in enumerate(branches):
        node_cost = cost.singularities * hinge(grid.singularity[branch])
        for joint in range(6):
            if cost.limits and joint not in aware:
                node_cost += cost.limits * limit_penalty(
                    grid.qs_rad[branch, joint],
                    grid.model.limits,
                    joint,
                    grid.margin_limits,
                    turning=bool(grid.turning[joint]),
                )
        nodes[:, i] = np.where(allowed[branch], node_cost * share, np.inf).T
        for start in range(0, n - 1, PIECE):
            stop = min(start + PIECE, n - 1)
            piece = grid.qs_rad[branch, :, :, start : stop + 1]
            steps[start:stop, i] = _step_costs(problem, piece, strides[start:stop], band)
    return Lattice(branches, nodes, steps, band, aware)


def _step_costs(problem: RollProblem, qs: Floats, strides: Floats, band: int) -> Floats:
    """Return the cost (m, 2 K + 1, R) of the steps between m + 1 path points, qs (6, R, m + 1)."""
    grid, cost, count = problem.grid, problem.cost, qs.shape[1]
    padded = np.concatenate((qs[:, count - band :], qs, qs[:, :band]), axis=1)[:, :, :-1]
    after = qs[:, :, 1:]
    result = np.zeros((len(strides), 2 * band + 1, count))
    largest = cost.largest_roll_rad(strides) + ROUNDING_RAD
    for o in range(2 * band + 1):
        squares, widest = np.zeros((2, count, len(strides)))
        for joint in range(6):
            change = after[joint] - padded[joint, o : o + count]
            if grid.turning[joint]:
                change -= TURN_RAD * np.rint(change * (1.0 / TURN_RAD))
            change *= change
            np.maximum(widest, change, out=widest)
            weight = cost.joint_weights[joint]
            squares += change if weight == 1.0 else weight**2 * change
        step_cost = cost.motion(squares, strides)
        step_cost[widest > grid.margin_limits.step_rad**2] = np.inf
        step_cost[:, abs(o - band) * grid.spacing_rad > largest] = np.inf
        if not grid.closed and o < band:
            step_cost[: band - o] = np.inf
        if not grid.closed and o > band:
            step_cost[count - (o - band) :] = np.inf
        result[:, o] = step_cost.T
    return result


MOST_AWARE = 3  # joints whose whole turns are counted at once
EVEN_COST = 1e-9
ASK_EVERY = 64  # path points between two questions whether to go on


@dataclass(frozen=True, slots=True, eq=False)
class LatticePath:
    """The cheapest path through a lattice, or how far any path leads."""

    branch: int  # of the arm; -1 where none leads through
    bins: Ints  # (n,) of the rolls; empty where none leads through
    furthest: int  # last path point that some path leads to; -1 if none is open at the first
    frontier: Bools  # (8, R) postures in which it can be reached


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

    First the whole turns of joints are not counted. If the curve found keeps the limits after all
    and pays no more for them, it is the optimum; otherwise turns are counted for the joints
    concerned, and the search is repeated.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    limits = problem.grid.model.limits
    branches = np.flatnonzero(problem.allowed().any(axis=1).all(axis=-1))
    aware: tuple[int, ...] = ()
    spun: RollCurve | None = None
    while True:
        lattice = build_lattice(problem, branches, aware)
        found = cheapest_path(lattice, problem, progress=progress, cancel=cancel)
        if found.branch < 0:
            if spun is None and len(branches) < N_BRANCHES:
                whole = build_lattice(problem, np.arange(N_BRANCHES))
                found = cheapest_path(whole, problem, progress=progress, cancel=cancel)
            return BlockedPath(found.furthest, found.frontier, spun)
        curve = curve_of(problem, found)
        more = _unpaid_joints(problem, found, curve) | set(aware)
        if more == set(aware) or len(more) > MOST_AWARE:
            if limits.clearance_rad(curve.qs_rad).min() >= 0.0:
                return curve
            return BlockedPath(found.furthest, found.frontier, curve)
        spun, aware = curve, tuple(sorted(more))


def curve_of(problem: RollProblem, found: LatticePath) -> RollCurve:
    """Return the rolls and joints of a path through the lattice, and its cost."""
    grid, points = problem.grid, np.arange(problem.grid.n_points)
    principal = grid.qs_rad[found.branch][:, found.bins, points]  # (6, n)
    principal[grid.turning] = np.unwrap(principal[grid.turning])
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
        q = curve.qs_rad[:, joint]
        principal = grid.qs_rad[found.branch, joint, found.bins, points]
        counted = limit_penalty(principal, limits, joint, grid.margin_limits, turning=True)
        paid = limit_penalty(q, limits, joint, grid.margin_limits, turning=False)
        outside = q.min() < limits.lower_rad[joint] or q.max() > limits.upper_rad[joint]
        if outside or problem.cost.limits * float((paid - counted).max()) > EVEN_COST:
            joints.add(joint)
    return joints


def cheapest_path(
    lattice: Lattice, problem: RollProblem, *, progress: Progress = silent, cancel: Cancel = never
) -> LatticePath:
    """Find the cheapest path; it keeps the limits of joints in ``lattice.aware``, turns counted.

    A state is a branch, the whole turns of each such joint, and a roll; a step from +179 to -179
    degrees adds a turn.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    n, rows, count = lattice.nodes.shape
    band, width, aware = lattice.band, 2 * lattice.band + 1, lattice.aware
    turns = [_turns(problem.grid.model.limits, joint) for joint in aware]
    shape = tuple(len(turns_of_joint) for turns_of_joint in turns)
    n_turns = int(np.prod(shape))
    gained = [_gained_turns(problem.grid, lattice, joint) for joint in aware]
    # the values at a path point, with infinity beyond the turns and neighbours beyond the rolls
    padded = np.full((rows, *(size + 2 for size in shape), count + 2 * band), np.inf)
    inner = (slice(None), *(slice(1, size + 1) for size in shape))
    numbers = np.arange(padded.size, dtype=np.int64).reshape(padded.shape)[inner]
    before = np.stack(
        [numbers[..., o : o + count].reshape(rows, n_turns, count) for o in range(width)], axis=2
    )  # (B, T, 2 K + 1, R): where the state before stands if no joint passes half a turn
    jumps = np.zeros((max(0, n - 1), *([1] * 3)), dtype=np.int64)
    for i, turns_of_step in enumerate(gained):
        jumps = jumps + padded.strides[1 + i] // padded.itemsize * turns_of_step
    values = _state_costs(lattice, problem, turns)
    offsets = np.zeros((max(0, n - 1), *values.shape[1:]), dtype=np.int8)  # of the best step
    furthest = 0 if np.isfinite(values[0]).any() else -1
    for k in range(n - 1):
        if furthest < k:
            break
        if k % ASK_EVERY == 0:
            if cancel():
                raise CancelledError(f"the search of a varying roll was cancelled at {k} of {n}")
            progress(k / n)
        padded[(*inner, slice(band, band + count))] = values[k].reshape(rows, *shape, count)
        if problem.grid.closed and band:
            padded[..., :band] = padded[..., count : count + band]
            padded[..., -band:] = padded[..., band : 2 * band]
        sums = padded.reshape(-1)[before + jumps[k][:, None]] + lattice.steps[k][:, None]
        offsets[k] = sums.argmin(axis=2)
        values[k + 1] += sums.min(axis=2)
        if np.isfinite(values[k + 1]).any():
            furthest = k + 1
    frontier = np.zeros((N_BRANCHES, count), dtype=np.bool_)
    if furthest >= 0:
        frontier[lattice.branches] = np.isfinite(values[furthest]).any(axis=1)
    if furthest < n - 1:
        return LatticePath(-1, np.zeros(0, dtype=np.int64), furthest, frontier)
    row, bins = _backtracked(values[-1], offsets, gained, shape, band)
    return LatticePath(int(lattice.branches[row]), bins, n - 1, frontier)


def _backtracked(
    values: Floats,
    offsets: NDArray[np.int8],
    gained: list[NDArray[np.int32]],
    shape: tuple[int, ...],
    band: int,
) -> tuple[int, Ints]:
    """Return the row of the branch and the bins (n,) of the path to the cheapest last state.

    Args:
        values: Costs (B, T, R) of the last states; of those that agree but for rounding the first
            counts.
        offsets: Best step (n - 1, B, T, R) to each state.
        gained: Turns (n - 1, B, 2 K + 1, R) that each aware joint gains on each step.
        shape: Numbers of whole turns of these joints.
        band: K.
    """
    end = np.unravel_index(int(np.argmin(np.round(values, EVEN_DIGITS))), values.shape)
    row, turn, bins = int(end[0]), int(end[1]), np.full(len(offsets) + 1, end[2], dtype=np.int64)
    count = values.shape[-1]
    for k in range(len(offsets) - 1, -1, -1):
        o = int(offsets[k, row, turn, bins[k + 1]])
        if shape:
            added = [int(steps[k, row, o, bins[k + 1]]) for steps in gained]
            turn = int(np.ravel_multi_index(np.add(np.unravel_index(turn, shape), added), shape))
        bins[k] = (bins[k + 1] + o - band) % count
    return row, bins


def _turns(limits: JointLimits, joint: int) -> Ints:
    """Return the whole turns by which a joint may stand away from its principal value."""
    first = np.ceil((limits.lower_rad[joint] - np.pi - ROUNDING_RAD) / TURN_RAD)
    last = np.floor((limits.upper_rad[joint] + np.pi + ROUNDING_RAD) / TURN_RAD)
    return np.arange(first, last + 1).astype(np.int64)


def _gained_turns(grid: RollGrid, lattice: Lattice, joint: int) -> NDArray[np.int32]:
    """Return the turns (n - 1, B, 2 K + 1, R) that the principal value gains on each step."""
    count, band = len(grid.rolls_rad), lattice.band
    q = grid.qs_rad[lattice.branches, joint]  # (B, R, n)
    padded = np.concatenate((q[:, count - band :], q, q[:, :band]), axis=1)[:, :, :-1]
    gained = [
        np.rint((q[:, :, 1:] - padded[:, o : o + count]) * (1.0 / TURN_RAD))
        for o in range(2 * band + 1)
    ]
    return np.stack(gained, axis=1).transpose(3, 0, 1, 2).astype(np.int32)


def _state_costs(lattice: Lattice, problem: RollProblem, turns: list[Ints]) -> Floats:
    """Return the cost (n, B, T, R) of each state by itself; infinite outside the limits."""
    grid, cost, limits = problem.grid, problem.cost, problem.grid.model.limits
    share = shares_of_points(problem.strides)[:, None, None]
    costs: list[Floats] = []
    for state in itertools.product(*turns):
        state_cost = lattice.nodes.copy()
        for joint, turn in zip(lattice.aware, state, strict=True):
            q = (grid.qs_rad[lattice.branches, joint] + TURN_RAD * turn).transpose(2, 0, 1)
            penalty = limit_penalty(q, limits, joint, grid.margin_limits, turning=False)
            state_cost += cost.limits * share * penalty
            state_cost[(q < limits.lower_rad[joint]) | (q > limits.upper_rad[joint])] = np.inf
        costs.append(state_cost)
    return np.stack(costs, axis=2)
