"""Lattice of a varying roll: the cost of each posture and of each small step along a path.

Steps join postures of the same branch at neighbouring path points whose rolls differ by a few
bins at most. What is not allowed costs infinity.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.robot.kinematics.joint_limits import TURN_RAD
from rona_core.robot.redundancy.cost import (
    RollCost,
    hinge,
    limit_penalty,
    shares_of_points,
    strides_of,
)
from rona_core.robot.redundancy.roll_grid import RollGrid

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
