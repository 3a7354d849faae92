"""Everything that is known of the constant rolls on one path: verdicts, and what they rest on."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.geometry.arrays import Floats
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.constant_roll import Sweep, sweep
from rona_core.robot.redundancy.infeasibility import blame, failing, passing, posture_of
from rona_core.robot.redundancy.margins import EVEN_DIGITS, RoomRules
from rona_core.robot.redundancy.result import RankedRoll, RollVerdict
from rona_core.robot.redundancy.roll_grid import RollGrid, flange_parts, follow_poses, roll_grid


@dataclass(frozen=True, slots=True, eq=False)
class JudgedRolls:
    """Everything known of constant rolls on one path; working memory of a search, never stored."""

    path: Path5D
    model: RobotModel
    rules: RoomRules
    grid: RollGrid
    swept: Sweep
    verdicts: tuple[RollVerdict, ...]
    ranked: tuple[RankedRoll, ...]


def judge_rolls(
    path: Path5D,
    model: RobotModel,
    rolls_deg: Floats,
    rules: RoomRules,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> JudgedRolls:
    """Judge constant rolls (R,) in degrees, ascending and evenly spaced, on every branch.

    Raises:
        DegenerateGeometryError: neighbouring axes of the path are opposite.
        CancelledError: somebody cancelled.
    """
    grid = roll_grid(path, model, np.deg2rad(rolls_deg), rules, progress=progress, cancel=cancel)
    swept = sweep(grid, model, rules)
    pairs = np.argwhere(swept.margins.T >= 0.0).tolist()
    ranked = [RankedRoll(i, branch, float(swept.margins[branch, i])) for i, branch in pairs]
    ranked.sort(key=lambda pair: -round(pair.margin, EVEN_DIGITS))
    return JudgedRolls(
        path=path,
        model=model,
        rules=rules,
        grid=grid,
        swept=swept,
        verdicts=_verdicts(rolls_deg, swept, path, model, rules),
        ranked=tuple(ranked),
    )


def _verdicts(
    rolls_deg: Floats, swept: Sweep, path: Path5D, model: RobotModel, rules: RoomRules
) -> tuple[RollVerdict, ...]:
    n, rolls = len(path), np.arange(len(rolls_deg))
    branches = swept.branches
    first = swept.first[branches, rolls]
    at = np.minimum(first, n - 1)
    parts = flange_parts(path, model)[:, at]
    failures = model.inverse(follow_poses(parts, np.deg2rad(rolls_deg)))
    tightest = np.argmin(np.round(swept.least, EVEN_DIGITS), axis=1)
    verdicts: list[RollVerdict] = []
    for i in rolls.tolist():
        roll_deg, branch = float(rolls_deg[i]), int(branches[i])
        margin, index = float(swept.margins[branch, i]), int(at[i])
        name = f"roll {roll_deg:.4g}°"
        if first[i] >= n:
            verdicts.append(passing(name, roll_deg, branch, margin, int(tightest[i])))
            continue
        q = swept.qs_rad[:, i, index]
        step = q - swept.qs_rad[:, i, max(0, index - 1)]
        cause = blame(posture_of(failures, i, branch, q, step), model.limits, rules)
        verdicts.append(failing(name, roll_deg, branch, margin, index, n, cause))
    return tuple(verdicts)
