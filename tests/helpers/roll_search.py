"""The search for a roll as ``plan_scan`` runs it, without timing, verifier and obstacles."""

import numpy as np

from rona_core.devices.protocols import never, silent
from rona_core.robot.redundancy.choice import (
    choose_constant_roll,
    search_without_roll,
    with_constant_roll,
    with_variable_roll,
    working_set_deg,
)
from rona_core.robot.redundancy.cost import RollCost
from rona_core.robot.redundancy.evaluate_rolls import evaluate_constant_rolls
from rona_core.robot.redundancy.joint_path import joint_path
from rona_core.robot.redundancy.margins import MarginLimits
from rona_core.robot.redundancy.roll_grid import solve_roll_grid
from rona_core.robot.redundancy.variable.optimal_roll import optimal_roll
from rona_core.robot.redundancy.variable.plan_variable_roll import plan_variable_roll
from rona_core.robot.redundancy.variable.problem import RollProblem


def search_rolls(
    path,
    model,
    *,
    working_set=(72, 0.0, 360.0),
    choice="best",
    mode="constant",
    margin_limits=None,
    progress=silent,
    cancel=never,
):
    limits = margin_limits or MarginLimits()
    evaluation = evaluate_constant_rolls(
        path,
        model,
        working_set_deg(*working_set),
        limits,
        progress=lambda share: progress(0.5 * share),
        cancel=cancel,
    )
    index = choose_constant_roll(evaluation.verdicts, choice)
    if index >= 0 and mode != "variable":
        verdict = evaluation.verdicts[index]
        roll_rad = np.deg2rad(verdict.roll_deg)
        qs = joint_path(path, model, roll_rad, verdict.branch, limits)
        return with_constant_roll(search_without_roll(evaluation), index, verdict.branch, qs)
    if mode == "constant":
        return search_without_roll(evaluation)
    curve, verdict = plan_variable_roll(
        evaluation.grid,
        RollCost(),
        progress=lambda share: progress(0.5 + 0.5 * share),
        cancel=cancel,
    )
    progress(1.0)
    search = search_without_roll(evaluation, verdict)
    return search if curve is None else with_variable_roll(search, curve)


def roll_problem(path, model, rolls_rad, margin_limits, cost, blocked=None):
    """A varying roll on a grid of rolls."""
    return RollProblem(solve_roll_grid(path, model, rolls_rad, margin_limits), cost, blocked)


def solved(path, model, rolls_rad, margin_limits, cost):
    """The optimum on a grid of rolls."""
    return optimal_roll(roll_problem(path, model, rolls_rad, margin_limits, cost))
