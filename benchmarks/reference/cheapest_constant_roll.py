"""The cheapest constant roll by the objective of the varying one, to compare with."""

from rona_core.robot.redundancy.cost import RollCost
from rona_core.robot.redundancy.evaluate_rolls import JudgedRolls
from rona_core.robot.redundancy.result import RollCurve
from rona_core.robot.redundancy.variable.optimal_roll import constant_curve


def cheapest_constant(judged: JudgedRolls, cost: RollCost) -> RollCurve | None:
    """Return the feasible constant roll that costs least in the objective of varying ones."""
    path, model, grid, rules = judged.path, judged.model, judged.grid, judged.rules
    curves = [
        constant_curve(path, model, grid, pair.index, pair.branch, rules, cost)
        for pair in judged.ranked
    ]
    return min(curves, key=lambda curve: curve.cost.total, default=None)
