"""Planning of a varying roll: optimum on the grid, refined, clear of obstacles."""

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.redundancy.cost import RollCost
from rona_core.robot.redundancy.infeasibility import FailureCause, infeasible_verdict
from rona_core.robot.redundancy.result import RollCurve, RollVerdict
from rona_core.robot.redundancy.roll_grid import RollGrid, solve_roll_grid
from rona_core.robot.redundancy.variable.collision_mask import block_collisions, blocked_retracts
from rona_core.robot.redundancy.variable.gauss_newton import refine_roll
from rona_core.robot.redundancy.variable.infeasibility import NAME, SLIGHT, variable_roll_verdict
from rona_core.robot.redundancy.variable.optimal_roll import BlockedPath, optimal_roll
from rona_core.robot.redundancy.variable.problem import RollProblem

WIDEST_RAD = np.deg2rad(5.0) + 1e-9  # between rolls through which a varying one is searched
MOST_DETOURS = 12  # searches round what was found to touch something
DETOUR_SHARE = 0.5  # of what is left of the progress


def plan_variable_roll(
    grid: RollGrid,
    cost: RollCost,
    *,
    blocked: Bools | None = None,
    clear: Clear | None = None,
    standoff_mm: float = 0.0,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> tuple[RollCurve | None, RollVerdict]:
    """Plan the cheapest roll that varies along the path, refined, and give the verdict on it.

    It never costs more than the cheapest constant roll of the set that keeps the same limits, in
    the same objective. Rolls that are more than 5 degrees apart get others in between.

    Args:
        grid: The rolls of the working set along the path.
        cost: The objective.
        blocked: Postures (n, R, 8) that must not be used; R is the number of ``refined_rolls``.
        clear: Tells for joint angles (m, 6) where nothing touches. The curve found is checked,
            and searched anew round the postures that touch.
        standoff_mm: The probe must be able to be retracted this far from both ends.
        progress: Told the share that is done.
        cancel: Asked on the way.

    Raises:
        InvalidInputError: ``blocked`` of another shape.
        CancelledError: somebody cancelled.
    """
    rolls_rad = refined_rolls(grid)
    if len(rolls_rad) != len(grid.rolls_rad):
        grid = solve_roll_grid(grid.path, grid.model, rolls_rad, grid.margin_limits, cancel=cancel)
    problem = RollProblem(grid, cost, blocked)
    if standoff_mm > 0.0:
        with_ends = problem.copy_blocked()
        with_ends[[0, -1]] |= blocked_retracts(grid, standoff_mm)
        problem = problem.with_blocked(with_ends)
    done, detours = 0.0, 0
    while True:
        found = optimal_roll(
            problem,
            progress=lambda share, done=done: progress(done + (1 - done) * DETOUR_SHARE * share),
            cancel=cancel,
        )
        if isinstance(found, BlockedPath):
            return None, variable_roll_verdict(problem, found)
        refined = refine_roll(problem, found, cancel=cancel)
        if clear is None or clear(refined.qs_rad).all():
            return refined, variable_roll_verdict(problem, refined)
        touched = np.flatnonzero(~clear(found.qs_rad))
        if not len(touched):  # what is finer than the grid came too near
            return found, variable_roll_verdict(problem, found)
        if detours == MOST_DETOURS:
            return None, _still_touches(found, touched)
        detours += 1
        problem = _around_collisions(problem, found, touched, clear)
        done += (1.0 - done) * DETOUR_SHARE


def _around_collisions(
    problem: RollProblem, found: RollCurve, touched: Ints, clear: Clear
) -> RollProblem:
    """Return the problem with what touches at some path points of a curve blocked."""
    grid, blocked = problem.grid, problem.copy_blocked()
    block_collisions(blocked, grid, touched, clear, problem.allowed())
    bins = np.round((found.rolls_rad - grid.rolls_rad[0]) / grid.spacing_rad).astype(np.int64)
    blocked[touched, bins[touched] % len(grid.rolls_rad), found.branch] = True
    return problem.with_blocked(blocked)


def refined_rolls(grid: RollGrid) -> Floats:
    """Return the rolls (R,) of a grid, with others in between if neighbours are too far apart."""
    pieces = int(np.ceil(grid.spacing_rad / WIDEST_RAD)) if len(grid.rolls_rad) > 1 else 1
    if pieces == 1:
        return grid.rolls_rad
    count = len(grid.rolls_rad) * pieces - (0 if grid.closed else pieces - 1)
    return grid.rolls_rad[0] + grid.spacing_rad / pieces * np.arange(count)


def _still_touches(found: RollCurve, touched: Ints) -> RollVerdict:
    """Return the verdict on a curve that could not be led round all that is touched."""
    index, roll_deg = int(touched[0]), float(np.rad2deg(found.rolls_rad[touched[0]]))
    words = f"{MOST_DETOURS} detours leave {len(touched)} points where the arm touches, first"
    cause = FailureCause("blocked", 0, float(len(touched)), 0.0, "", words)
    name, n = f"{NAME}, there {roll_deg:.4g}°", len(found.rolls_rad)
    return infeasible_verdict(name, roll_deg, found.branch, -SLIGHT, index, n, cause)
