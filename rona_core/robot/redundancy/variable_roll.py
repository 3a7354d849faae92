"""Planning of a varying roll: optimum on the grid, refined, clear of obstacles."""

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.redundancy.cost import RollCost
from rona_core.robot.redundancy.gauss_newton import refine_roll
from rona_core.robot.redundancy.infeasibility import still_touches, variable_roll_verdict
from rona_core.robot.redundancy.lattice import RollProblem
from rona_core.robot.redundancy.margins import flange_poses, limit_margin, reach_margin
from rona_core.robot.redundancy.optimal_roll import BlockedPath, optimal_roll
from rona_core.robot.redundancy.result import RollCurve, RollVerdict
from rona_core.robot.redundancy.roll_grid import RollGrid, solve_roll_grid

WIDEST_RAD = np.deg2rad(5.0) + 1e-9  # between rolls through which a varying one is searched
MOST_DETOURS = 12  # searches round what was found to touch something
MOST_POINTS = 32  # path points whose postures are all checked in one go
DETOUR_SHARE = 0.5  # of what is left of the progress


def plan_variable_roll(
    grid: RollGrid,
    cost: RollCost,
    *,
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
        clear: Maps joint angles (m, 6) to where nothing is touched. The curve found is checked,
            and searched anew round the postures that touch.
        standoff_mm: The probe must be able to be retracted this far from both ends.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked on the way.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    rolls_rad = refined_rolls(grid)
    if len(rolls_rad) != len(grid.rolls_rad):
        grid = solve_roll_grid(grid.path, grid.model, rolls_rad, grid.margin_limits, cancel=cancel)
    problem = RollProblem(grid, cost)
    if standoff_mm > 0.0:
        blocked = problem.blocked.copy()
        blocked[[0, -1]] |= blocked_retracts(grid, standoff_mm)
        problem = problem.with_blocked(blocked)
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
            return None, still_touches(found, touched, MOST_DETOURS)
        detours += 1
        problem = _around_collisions(problem, found, touched, clear)
        done += (1.0 - done) * DETOUR_SHARE


def refined_rolls(grid: RollGrid) -> Floats:
    """Return the rolls (R,) of a grid, with others in between if neighbours are too far apart."""
    pieces = int(np.ceil(grid.spacing_rad / WIDEST_RAD)) if len(grid.rolls_rad) > 1 else 1
    if pieces == 1:
        return grid.rolls_rad
    count = len(grid.rolls_rad) * pieces - (0 if grid.closed else pieces - 1)
    return grid.rolls_rad[0] + grid.spacing_rad / pieces * np.arange(count)


def blocked_retracts(grid: RollGrid, standoff_mm: float) -> Bools:
    """Return the postures (2, R, 8) at both ends from which the probe cannot be retracted.

    Args:
        grid: Postures along the path.
        standoff_mm: How far it has to be retracted along its axis.
    """
    ends, n_rolls, model = [0, grid.n_points - 1], len(grid.rolls_rad), grid.model
    parts = grid.flange_parts[:, ends]
    parts[2, :, 9:] -= standoff_mm * grid.path.axes_base[ends]
    result = np.zeros((2, n_rolls, len(grid.margins)), dtype=np.bool_)
    for end in range(2):
        parts_at_end = np.repeat(parts[:, end : end + 1], n_rolls, axis=1)
        solutions = model.inverse(flange_poses(parts_at_end, grid.rolls_rad))
        angles = solutions.qs_rad.transpose(2, 0, 1)
        limit = limit_margin(angles, model.limits, grid.turning, grid.margin_limits)
        result[end] = np.minimum(limit, reach_margin(solutions, grid.margin_limits)) < 0.0
    return result


def _around_collisions(
    problem: RollProblem, found: RollCurve, touched: Ints, clear: Clear
) -> RollProblem:
    """Return the problem with what touches at some path points (k,) of a curve blocked.

    Of many points some are checked, spread evenly, and stand for their neighbours. Postures that
    are not allowed anyway are not checked.
    """
    grid, blocked, allowed = problem.grid, problem.blocked.copy(), problem.allowed()
    most = np.linspace(0, len(touched) - 1, min(MOST_POINTS, len(touched)))
    some = touched[np.unique(most.astype(np.int64))]
    touches = np.zeros((len(some), *grid.shape[1:]), dtype=np.bool_)
    for row, point in enumerate(some):
        branch, roll = np.nonzero(allowed[:, :, point])
        if len(branch):
            touches[row, roll, branch] = ~clear(grid.qs_rad[branch, :, roll, point])
    blocked[touched] |= touches[np.abs(touched[:, None] - some).argmin(axis=1)]
    bins = problem.bins_of(found.rolls_rad)[touched] % len(grid.rolls_rad)
    blocked[touched, bins, found.branch] = True
    return problem.with_blocked(blocked)
