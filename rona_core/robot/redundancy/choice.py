"""Working set of rolls, the choice among them, and the search that holds the chosen one.

Every constant roll of a working set is evaluated on every branch of the arm: reach, singularities,
joint limits, discontinuities (RONA, Section III.D and Figure 8). Where none will do, or on request,
the roll may vary along the path.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from rona_core.devices.settings import require
from rona_core.geometry.arrays import Floats, readonly
from rona_core.robot.redundancy.evaluate_rolls import RollEvaluation
from rona_core.robot.redundancy.result import RollCurve, RollSearch, RollVerdict

Choice = Literal["best", "first"]
RollMode = Literal["auto", "constant", "variable"]

FULL_TURN_DEG = 360.0
MAX_SHOWN = 240  # samples of each joint curve that are kept for drawing


def working_set_deg(n_rolls: int, roll_from_deg: float, roll_to_deg: float) -> Floats:
    """Return the working set V of rolls (n,), evenly spaced; a full turn does not repeat its first.

    Raises:
        InvalidInputError: no roll, or an empty or endless range.
    """
    require(1 <= n_rolls <= 3600, f"n_rolls must be 1 to 3600, not {n_rolls}")
    span = roll_to_deg - roll_from_deg
    require(
        bool(np.isfinite(span)) and 0.0 <= span <= FULL_TURN_DEG,
        f"rolls must run upwards over at most 360 degrees, not {roll_from_deg} to {roll_to_deg}",
    )
    whole = span > FULL_TURN_DEG - 1e-9
    return np.linspace(roll_from_deg, roll_to_deg, n_rolls, endpoint=not whole)


def choose_constant_roll(verdicts: tuple[RollVerdict, ...], choice: Choice) -> int:
    """Choose the feasible roll with the largest margin, or the first; -1 where none is feasible."""
    feasible = [i for i, verdict in enumerate(verdicts) if verdict.feasible]
    if choice == "first":
        return min(feasible, default=-1)
    return max(feasible, key=lambda i: verdicts[i].margin, default=-1)


def search_without_roll(
    evaluation: RollEvaluation, varying: RollVerdict | None = None
) -> RollSearch:
    """Return the search with every verdict and no roll chosen.

    Args:
        evaluation: The constant rolls.
        varying: The verdict on a varying roll; None where none was looked for.
    """
    grid, rolls = evaluation.grid, evaluation.rolls
    shown = np.unique(np.round(np.linspace(0, grid.n_points - 1, MAX_SHOWN)).astype(np.int64))
    nodes = np.minimum.reduceat(grid.margins.max(axis=0), shown, axis=1).T
    return RollSearch(
        mode="none",
        verdicts=evaluation.verdicts,
        ranked=evaluation.ranked,
        varying=varying,
        chosen=-1,
        branch=-1,
        rolls_rad=readonly(np.zeros(grid.n_points)),
        path=grid.path,
        shown_points=readonly(shown),
        curves_rad=readonly(rolls.qs_rad[:, :, shown].transpose(1, 2, 0).astype(np.float32)),
        room=readonly(np.minimum.reduceat(rolls.margins, shown, axis=1).astype(np.float32)),
        node_room=readonly(nodes.astype(np.float32)),
        chosen_curve_rad=readonly(np.zeros((0, 6), dtype=np.float32)),
    )


def with_constant_roll(search: RollSearch, index: int, branch: int, qs_rad: Floats) -> RollSearch:
    """Return the search with one of its constant rolls chosen, and its joints (n, 6)."""
    rolls_rad = np.full(len(search.path), np.deg2rad(search.verdicts[index].roll_deg))
    chosen = replace(search, mode="constant", chosen=index)
    return _with_curve(chosen, rolls_rad, branch, qs_rad)


def with_variable_roll(search: RollSearch, curve: RollCurve) -> RollSearch:
    """Return the search with a roll chosen that varies along the path."""
    chosen = replace(search, mode="variable", chosen=-1)
    return _with_curve(chosen, curve.rolls_rad, curve.branch, curve.qs_rad)


def _with_curve(search: RollSearch, rolls_rad: Floats, branch: int, qs_rad: Floats) -> RollSearch:
    return replace(
        search,
        branch=branch,
        rolls_rad=readonly(rolls_rad),
        chosen_curve_rad=readonly(qs_rad[search.shown_points].astype(np.float32)),
    )
