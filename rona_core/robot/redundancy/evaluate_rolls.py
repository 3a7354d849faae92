"""Evaluation of the constant rolls of a working set on one path: verdicts and ranking."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.geometry.arrays import Floats
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.constant_roll import ConstantRolls, follow_constant_rolls
from rona_core.robot.redundancy.infeasibility import (
    feasible_verdict,
    find_failure_cause,
    infeasible_verdict,
    posture_at,
)
from rona_core.robot.redundancy.margins import EVEN_DIGITS, MarginLimits
from rona_core.robot.redundancy.result import RankedRoll, RollVerdict
from rona_core.robot.redundancy.roll_grid import RollGrid, flange_poses, solve_roll_grid


@dataclass(frozen=True, slots=True, eq=False)
class RollEvaluation:
    """Everything known of constant rolls on one path; working memory of a search, never stored."""

    grid: RollGrid
    rolls: ConstantRolls
    verdicts: tuple[RollVerdict, ...]
    ranked: tuple[RankedRoll, ...]  # feasible rolls and branches, largest margin first


def evaluate_constant_rolls(
    path: Path5D,
    model: RobotModel,
    rolls_deg: Floats,
    margin_limits: MarginLimits,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RollEvaluation:
    """Evaluate constant rolls (R,) in degrees, ascending and evenly spaced, on every branch.

    Raises:
        DegenerateGeometryError: neighbouring axes of the path are opposite.
        CancelledError: somebody cancelled.
    """
    rolls_rad = np.deg2rad(rolls_deg)
    grid = solve_roll_grid(path, model, rolls_rad, margin_limits, progress=progress, cancel=cancel)
    rolls = follow_constant_rolls(grid)
    pairs = np.argwhere(rolls.branch_margins.T >= 0.0).tolist()
    ranked = [RankedRoll(i, branch, float(rolls.branch_margins[branch, i])) for i, branch in pairs]
    ranked.sort(key=lambda pair: -round(pair.margin, EVEN_DIGITS))
    return RollEvaluation(grid, rolls, _verdicts(rolls_deg, grid, rolls), tuple(ranked))


def _verdicts(rolls_deg: Floats, grid: RollGrid, rolls: ConstantRolls) -> tuple[RollVerdict, ...]:
    """Return a verdict on each roll (R,) on its best branch."""
    n, numbers, branches = grid.n_points, np.arange(len(rolls_deg)), rolls.branches
    first = rolls.first_failures[branches, numbers]
    failing_points = np.minimum(first, n - 1)
    parts = grid.flange_parts[:, failing_points]
    solutions = grid.model.inverse(flange_poses(parts, np.deg2rad(rolls_deg)))
    tightest = np.argmin(np.round(rolls.margins, EVEN_DIGITS), axis=1)
    verdicts: list[RollVerdict] = []
    for i in numbers.tolist():
        roll_deg, branch = float(rolls_deg[i]), int(branches[i])
        margin, index = float(rolls.branch_margins[branch, i]), int(failing_points[i])
        name = f"roll {roll_deg:.4g}°"
        if first[i] >= n:
            verdicts.append(feasible_verdict(name, roll_deg, branch, margin, int(tightest[i])))
            continue
        q = rolls.qs_rad[:, i, index]
        step = q - rolls.qs_rad[:, i, max(0, index - 1)]
        posture = posture_at(solutions, i, branch, q, step)
        cause = find_failure_cause(posture, grid.model.limits, grid.margin_limits)
        verdicts.append(infeasible_verdict(name, roll_deg, branch, margin, index, n, cause))
    return tuple(verdicts)
