"""Dynamic programming over a lattice of rolls: the cheapest path through it.

Bellman's recursion over the path points k, with the costs N of postures and S of steps of the
lattice (a ladder graph, Maeyer 2017):
V[k + 1, r] = min over o of (V[k, r + o - K] + S[k, o, r]) + N[k + 1, r].
See docs/algorithms/robot/variable_roll.md.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Floats, Ints
from rona_core.robot.kinematics.joint_limits import TURN_RAD, JointLimits
from rona_core.robot.redundancy.cost import limit_penalty, shares_of_points
from rona_core.robot.redundancy.margins import EVEN_DIGITS
from rona_core.robot.redundancy.roll_grid import RollGrid
from rona_core.robot.redundancy.variable.lattice import Lattice
from rona_core.robot.redundancy.variable.problem import RollProblem

ASK_EVERY = 64  # path points between two questions whether to go on
ROUNDING_RAD = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class LatticePath:
    """The cheapest path through a lattice, or how far any path leads."""

    cost: float  # infinite where none leads through
    branch: int  # of the arm; -1 where none leads through
    bins: Ints  # (n,) of the rolls; empty where none leads through
    furthest: int  # last path point that some path leads to; -1 if none is open at the first
    frontier: Floats  # (8, R) costs of the paths that lead there


def cheapest_path(
    lattice: Lattice, *, progress: Progress = silent, cancel: Cancel = never, n_branches: int = 8
) -> LatticePath:
    """Find the cheapest path; the whole turns that joints make are not counted.

    Raises:
        CancelledError: somebody cancelled.
    """
    n, _, count = lattice.nodes.shape
    band = lattice.band
    values = np.zeros_like(lattice.nodes)
    values[0] = lattice.nodes[0]
    padded = np.full((len(lattice.branches), count + 2 * band), np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * band + 1, axis=1)
    from_bins = windows.transpose(0, 2, 1)  # (B, 2 K + 1, R), a view that follows ``padded``
    sums = np.zeros(from_bins.shape)
    middle = slice(band, band + count)
    furthest = 0 if np.isfinite(values[0]).any() else -1
    for k in range(n - 1):
        if furthest < k:
            break
        if k % ASK_EVERY == 0:
            _report(k, n, progress, cancel)
        padded[:, middle] = values[k]
        if lattice.closed and band:
            padded[:, :band], padded[:, -band:] = values[k, :, -band:], values[k, :, :band]
        np.add(from_bins, lattice.steps[k], out=sums)
        np.min(sums, axis=1, out=values[k + 1])
        values[k + 1] += lattice.nodes[k + 1]
        if np.isfinite(values[k + 1].min(initial=np.inf)):
            furthest = k + 1
    reached = np.full((n_branches, count), np.inf)
    if len(lattice.branches) and furthest >= 0:
        reached[lattice.branches] = values[furthest]
    if furthest < n - 1 or not len(lattice.branches):
        return LatticePath(np.inf, -1, np.zeros(0, dtype=np.int64), furthest, reached)
    row, last = _least(values[-1])
    bins = np.zeros(n, dtype=np.int64)
    bins[-1] = last
    offsets = np.arange(-band, band + 1)
    for k in range(n - 2, -1, -1):
        before = (bins[k + 1] + offsets) % count  # outside an open range the step is infinite
        costs = values[k, row, before] + lattice.steps[k, row, :, bins[k + 1]]
        bins[k] = before[int(np.argmin(costs))]
    return LatticePath(
        float(values[-1, row, last]), int(lattice.branches[row]), bins, n - 1, reached
    )


def cheapest_path_with_turns(
    lattice: Lattice,
    problem: RollProblem,
    aware: tuple[int, ...],
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> LatticePath:
    """Find the cheapest path that keeps the limits of some joints, whole turns counted.

    A state is a branch, a roll and the whole turns of each joint in ``aware``; a step from +179 to
    -179 degrees adds one. The lattice must leave the limits of these joints out.

    Raises:
        CancelledError: somebody cancelled.
    """
    n, rows, count = lattice.nodes.shape
    band, width = lattice.band, 2 * lattice.band + 1
    ranges = [_turns(problem.grid.model.limits, joint) for joint in aware]
    shape = tuple(len(turns) for turns in ranges)
    padded = np.full((rows, *(size + 2 for size in shape), count + 2 * band), np.inf)
    inner = (slice(None), *(slice(1, size + 1) for size in shape), slice(band, band + count))
    numbers = np.arange(padded.size, dtype=np.int64).reshape(padded.shape)
    base = np.stack(
        [
            numbers[(*inner[:-1], slice(o, o + count))].reshape(rows, -1, count)
            for o in range(width)
        ],
        axis=2,
    )  # (B, T, 2 K + 1, R): where the state before stands if no joint passes half a turn
    jumps = [
        padded.strides[1 + i] // padded.itemsize * _crossings(problem.grid, lattice, joint)
        for i, joint in enumerate(aware)
    ]
    crossed = np.sum(jumps, axis=0)  # (n - 1, B, 2 K + 1, R)
    values = _state_costs(lattice, problem, aware, ranges)
    flat = padded.reshape(-1)
    furthest = 0 if np.isfinite(values[0]).any() else -1
    for k in range(n - 1):
        if furthest < k:
            break
        if k % ASK_EVERY == 0:
            _report(k, n, progress, cancel)
        padded[inner] = values[k].reshape(rows, *shape, count)
        if lattice.closed and band:
            padded[..., :band] = padded[..., count : count + band]
            padded[..., -band:] = padded[..., band : 2 * band]
        sums = flat[base + crossed[k][:, None]] + lattice.steps[k][:, None]
        values[k + 1] += sums.min(axis=2)
        if np.isfinite(values[k + 1].min(initial=np.inf)):
            furthest = k + 1
    reached = np.full((8, count), np.inf)
    if furthest >= 0:
        reached[lattice.branches] = values[furthest].min(axis=1)
    if furthest < n - 1:
        return LatticePath(np.inf, -1, np.zeros(0, dtype=np.int64), furthest, reached)
    row, turn, last = _least(values[-1])
    bins = _backtrack(values, lattice, crossed, base, padded, inner, (row, turn, last))
    total = float(values[-1, row, turn, last])
    return LatticePath(total, int(lattice.branches[row]), bins, n - 1, reached)


def _backtrack(
    values: Floats,
    lattice: Lattice,
    crossed: NDArray[np.int32],
    base: Ints,
    padded: Floats,
    inner: tuple[slice, ...],
    end: tuple[int, int, int],
) -> Ints:
    """Return the bins (n,) of the path that ends in a state (row, turn, bin)."""
    n, band, count = len(values), lattice.band, values.shape[-1]
    row, turn, last = end
    bins = np.zeros(n, dtype=np.int64)
    bins[-1] = last
    places = np.full(padded.shape, -1, dtype=np.int64)  # number of the state that stands there
    states = np.arange(values[0].size, dtype=np.int64).reshape(padded[inner].shape)
    places[inner] = states
    if lattice.closed and band:
        places[..., :band] = places[..., count : count + band]
        places[..., -band:] = places[..., band : 2 * band]
    flat = places.reshape(-1)
    for k in range(n - 2, -1, -1):
        now = bins[k + 1]
        before = flat[base[row, turn, :, now] + crossed[k, row, :, now]]
        costs = np.where(before >= 0, values[k].reshape(-1)[before], np.inf)
        state = before[int(np.argmin(costs + lattice.steps[k, row, :, now]))]
        _, turn, bins[k] = np.unravel_index(state, values[k].shape)
    return bins


def _turns(limits: JointLimits, joint: int) -> Ints:
    """Return the whole turns by which a joint may stand away from its principal value."""
    first = np.ceil((limits.lower_rad[joint] - np.pi - ROUNDING_RAD) / TURN_RAD)
    last = np.floor((limits.upper_rad[joint] + np.pi + ROUNDING_RAD) / TURN_RAD)
    return np.arange(first, last + 1).astype(np.int64)


def _crossings(grid: RollGrid, lattice: Lattice, joint: int) -> NDArray[np.int32]:
    """Return the turns (n - 1, B, 2 K + 1, R) that the principal value gains on each step."""
    count, band = len(grid.rolls_rad), lattice.band
    q = grid.qs_rad[lattice.branches, joint]  # (B, R, n)
    padded = np.concatenate((q[:, count - band :], q, q[:, :band]), axis=1)[:, :, :-1]
    gained = [
        np.rint((q[:, :, 1:] - padded[:, o : o + count]) * (1.0 / TURN_RAD))
        for o in range(2 * band + 1)
    ]
    return np.stack(gained, axis=1).transpose(3, 0, 1, 2).astype(np.int32)


def _state_costs(
    lattice: Lattice, problem: RollProblem, aware: tuple[int, ...], ranges: list[Ints]
) -> Floats:
    """Return the cost (n, B, T, R) of each state by itself; infinite outside the limits."""
    n, rows, count = lattice.nodes.shape
    grid, cost, limits = problem.grid, problem.cost, problem.grid.model.limits
    states = list(itertools.product(*ranges))
    result = np.zeros((n, rows, len(states), count))
    share = shares_of_points(problem.strides)
    for t, turns in enumerate(states):
        state_cost = lattice.nodes.copy()
        for joint, turn in zip(aware, turns, strict=True):
            lower, upper = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
            q = (grid.qs_rad[lattice.branches, joint] + TURN_RAD * turn).transpose(2, 0, 1)
            penalty = limit_penalty(q, lower, upper, grid.margin_limits, turning=False)
            state_cost += cost.limits * share[:, None, None] * penalty
            state_cost[(q < lower) | (q > upper)] = np.inf
        result[:, :, t] = state_cost
    return result


def _least(values: Floats) -> tuple[int, ...]:
    """Return where the least value stands, the first of those that agree but for rounding."""
    place = np.unravel_index(int(np.argmin(np.round(values, EVEN_DIGITS))), values.shape)
    return tuple(int(i) for i in place)


def _report(k: int, n: int, progress: Progress, cancel: Cancel) -> None:
    if cancel():
        raise CancelledError(f"the search of a varying roll was cancelled at point {k} of {n}")
    progress(k / n)
