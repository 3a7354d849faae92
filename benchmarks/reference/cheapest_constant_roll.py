"""The cheapest constant roll by the objective of the varying one, to compare with."""

import numpy as np

from rona_core.robot.redundancy.constant_roll import RollEvaluation
from rona_core.robot.redundancy.optimal_roll import LatticePath, RollProblem, curve_of
from rona_core.robot.redundancy.result import RankedRoll, RollCost, RollCurve


def cheapest_constant(evaluation: RollEvaluation, cost: RollCost) -> RollCurve | None:
    """Return the feasible constant roll that costs least in the objective of varying ones."""
    problem = RollProblem(evaluation.grid(), cost)
    curves = [_constant_curve(problem, pair) for pair in evaluation.ranked]
    return min(curves, key=lambda curve: curve.cost.total, default=None)


def _constant_curve(problem: RollProblem, pair: RankedRoll) -> RollCurve:
    """Return a constant roll of the grid as a curve, with the cost of the same objective."""
    n = problem.grid.n_points
    bins = np.full(n, pair.index, dtype=np.int64)
    return curve_of(
        problem, LatticePath(pair.branch, bins, n - 1, np.zeros((8, 0), dtype=np.bool_))
    )
