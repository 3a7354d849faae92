"""The cheapest constant roll by the objective of the varying one, to compare with."""

import numpy as np

from rona_core.robot.redundancy.cost import RollCost
from rona_core.robot.redundancy.evaluate_rolls import RollEvaluation
from rona_core.robot.redundancy.result import RankedRoll, RollCurve
from rona_core.robot.redundancy.variable.dynamic_program import LatticePath
from rona_core.robot.redundancy.variable.optimal_roll import curve_of
from rona_core.robot.redundancy.variable.problem import RollProblem


def cheapest_constant(evaluation: RollEvaluation, cost: RollCost) -> RollCurve | None:
    """Return the feasible constant roll that costs least in the objective of varying ones."""
    problem = RollProblem(evaluation.grid, cost)
    curves = [_constant_curve(problem, pair) for pair in evaluation.ranked]
    return min(curves, key=lambda curve: curve.cost.total, default=None)


def _constant_curve(problem: RollProblem, pair: RankedRoll) -> RollCurve:
    """Return a constant roll of the grid as a curve, with the cost of the same objective."""
    n = problem.grid.n_points
    bins = np.full(n, pair.index, dtype=np.int64)
    return curve_of(problem, LatticePath(0.0, pair.branch, bins, n - 1, np.zeros((8, 0))))
