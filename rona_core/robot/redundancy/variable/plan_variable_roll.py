"""Find the roll that varies along a path: optimum on the grid, refined, clear of obstacles."""

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.redundancy.cost import RollCost
from rona_core.robot.redundancy.evaluate_rolls import JudgedRolls
from rona_core.robot.redundancy.infeasibility import Blame, failing
from rona_core.robot.redundancy.result import RollCurve, RollVerdict
from rona_core.robot.redundancy.roll_grid import RollGrid, roll_grid
from rona_core.robot.redundancy.variable.collision_mask import dead_ends, shut_out, touching
from rona_core.robot.redundancy.variable.gauss_newton import refine_roll
from rona_core.robot.redundancy.variable.infeasibility import NAME, SLIGHT, varying_verdict
from rona_core.robot.redundancy.variable.lattice import open_nodes
from rona_core.robot.redundancy.variable.optimal_roll import NoWay, optimal_roll

WIDEST_RAD = np.deg2rad(5.0) + 1e-9  # between rolls through which a varying one is searched
MOST_DETOURS = 12  # searches round what was found to touch something
DETOUR_SHARE = 0.5  # of what is left of the progress


def vary_roll(
    judged: JudgedRolls,
    cost: RollCost,
    *,
    blocked: Bools | None = None,
    clear: Clear | None = None,
    standoff_mm: float = 0.0,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> tuple[RollCurve | None, RollVerdict]:
    """Return the cheapest roll that varies along the path, refined, and the verdict on it.

    It never costs more than the cheapest constant roll of the set that keeps the same rules, in
    the same objective. Rolls that are more than 5 degrees apart get others in between.

    Args:
        judged: The rolls of the working set.
        cost: The objective.
        blocked: Postures (n, R, 8) that must not be used; R is the number of ``varying_rolls``.
        clear: Tells for joint angles (m, 6) where nothing touches. The way found is looked at,
            and searched anew round the postures that touch.
        standoff_mm: The probe must be able to be drawn back this far from both ends.
        progress: Told the share that is done.
        cancel: Asked on the way.

    Raises:
        InvalidInputError: ``blocked`` of another shape.
        CancelledError: somebody cancelled.
    """
    path, model, grid, rules = judged.path, judged.model, judged.grid, judged.rules
    rolls_rad = varying_rolls(grid)
    if len(rolls_rad) != len(grid.rolls_rad):
        grid = roll_grid(path, model, rolls_rad, rules, cancel=cancel)
    shut = blocked
    if standoff_mm > 0.0:
        shut = _copy(blocked, grid)
        shut[[0, -1]] |= dead_ends(path, model, grid, rules, standoff_mm)
    done, detours = 0.0, 0
    while True:
        found = optimal_roll(
            path,
            model,
            grid,
            rules,
            cost,
            blocked=shut,
            progress=lambda share, done=done: progress(done + (1 - done) * DETOUR_SHARE * share),
            cancel=cancel,
        )
        if isinstance(found, NoWay):
            return None, varying_verdict(found, path, model, grid, rules, cost, shut)
        fine = refine_roll(path, model, grid, found, rules, cost, blocked=shut, cancel=cancel)
        if clear is None or clear(fine.qs_rad).all():
            return fine, varying_verdict(fine, path, model, grid, rules, cost)
        touched = np.flatnonzero(~clear(found.qs_rad))
        if not len(touched):  # what is finer than the grid came too near
            return found, varying_verdict(found, path, model, grid, rules, cost)
        if detours == MOST_DETOURS:
            return None, _still_touches(found, touched)
        detours += 1
        shut = _copy(shut, grid)
        some, touches = touching(grid, touched, clear, open_nodes(grid, shut))
        shut_out(shut, touched, some, touches)
        bins = np.round((found.rolls_rad - grid.rolls_rad[0]) / grid.spacing_rad).astype(np.int64)
        shut[touched, bins[touched] % len(grid.rolls_rad), found.branch] = True
        done += (1.0 - done) * DETOUR_SHARE


def varying_rolls(grid: RollGrid) -> Floats:
    """Return the rolls (R,) of a grid, with others in between if neighbours are too far apart."""
    pieces = int(np.ceil(grid.spacing_rad / WIDEST_RAD)) if len(grid.rolls_rad) > 1 else 1
    if pieces == 1:
        return grid.rolls_rad
    count = len(grid.rolls_rad) * pieces - (0 if grid.closed else pieces - 1)
    return grid.rolls_rad[0] + grid.spacing_rad / pieces * np.arange(count)


def _copy(blocked: Bools | None, grid: RollGrid) -> Bools:
    shape = (grid.n_points, len(grid.rolls_rad), len(grid.room))
    return np.zeros(shape, dtype=np.bool_) if blocked is None else blocked.copy()


def _still_touches(found: RollCurve, touched: Ints) -> RollVerdict:
    """Return the verdict on a way that could not be led round all that is touched."""
    index, roll_deg = int(touched[0]), float(np.rad2deg(found.rolls_rad[touched[0]]))
    words = f"{MOST_DETOURS} detours leave {len(touched)} points where the arm touches, first"
    cause = Blame("blocked", 0, float(len(touched)), 0.0, "", words)
    name, n = f"{NAME}, there {roll_deg:.4g}°", len(found.rolls_rad)
    return failing(name, roll_deg, found.branch, -SLIGHT, index, n, cause)
