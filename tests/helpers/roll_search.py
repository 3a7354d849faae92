"""The search for a roll as ``plan_scan`` runs it, without timing, verifier and obstacles."""

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.geometry.arrays import Floats
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.constant_roll import (
    choose_constant_roll,
    evaluate_constant_rolls,
    working_set_deg,
)
from rona_core.robot.redundancy.margins import MarginLimits, joint_path, solve_roll_grid
from rona_core.robot.redundancy.optimal_roll import BlockedPath, RollProblem, optimal_roll
from rona_core.robot.redundancy.result import Choice, RollCost, RollCurve, RollMode, RollSearch
from rona_core.robot.redundancy.variable_roll import plan_variable_roll


def search_rolls(
    path: Path5D,
    model: RobotModel,
    *,
    working_set: tuple[int, float, float] = (72, 0.0, 360.0),
    choice: Choice = "best",
    mode: RollMode = "constant",
    margin_limits: MarginLimits | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RollSearch:
    """Search a roll among a working set (count, first, last degrees), or one that varies."""
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
        roll_rad = float(np.deg2rad(verdict.roll_deg))
        qs = joint_path(path, model, roll_rad, verdict.branch)
        return evaluation.search().with_constant_roll(index, verdict.branch, qs)
    if mode == "constant":
        return evaluation.search()
    curve, verdict = plan_variable_roll(
        evaluation.grid(),
        RollCost(),
        progress=lambda share: progress(0.5 + 0.5 * share),
        cancel=cancel,
    )
    progress(1.0)
    search = evaluation.search(verdict)
    return search if curve is None else search.with_variable_roll(curve)


def roll_problem(
    path: Path5D, model: RobotModel, rolls_rad: Floats, margin_limits: MarginLimits, cost: RollCost
) -> RollProblem:
    """A varying roll on a grid of rolls."""
    return RollProblem(solve_roll_grid(path, model, rolls_rad, margin_limits), cost)


def solved(
    path: Path5D, model: RobotModel, rolls_rad: Floats, margin_limits: MarginLimits, cost: RollCost
) -> RollCurve | BlockedPath:
    """The optimum on a grid of rolls."""
    return optimal_roll(roll_problem(path, model, rolls_rad, margin_limits, cost))
