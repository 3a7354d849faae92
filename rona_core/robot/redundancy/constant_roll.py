"""Constant rolls on every branch: least margin, where it is, and where each first fails."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.robot.kinematics.joint_limits import TURN_RAD, shift_to_fit
from rona_core.robot.redundancy.margins import EVEN_DIGITS
from rona_core.robot.redundancy.roll_grid import RollGrid


@dataclass(frozen=True, slots=True, eq=False)
class ConstantRolls:
    """The joint paths and margins of constant rolls; R rolls, n path points."""

    branch_margins: Floats  # (8, R) least margin along the path
    first_failures: Ints  # (8, R) path point that fails first; n where none does
    branches: Ints  # (R,) the branch with the largest margin, or the one that gets furthest
    margins: Floats  # (R, n) of that branch, with those of the steps
    qs_rad: Floats  # (6, R, n) that branch, continuous, turned so that it fits its limits


def follow_constant_rolls(grid: RollGrid) -> ConstantRolls:
    """Follow every roll of a grid on every branch along the whole path."""
    n_branches, count, n = grid.margins.shape
    margins = np.zeros((n_branches, count, n))
    for branch in range(n_branches):
        margins[branch] = constant_roll_margins(grid, branch)
    least = margins.min(axis=2)
    first = np.where(least < 0.0, (margins < 0.0).argmax(axis=2), n)
    branches = np.array([best_branch(least[:, i], first[:, i]) for i in range(count)], np.int64)
    rolls, model = np.arange(count), grid.model
    qs = np.ascontiguousarray(grid.qs_rad[branches, :, rolls].transpose(1, 0, 2))
    for joint in np.flatnonzero(grid.turning):
        lower, upper = float(model.lower_rad[joint]), float(model.upper_rad[joint])
        qs[joint] = shift_to_fit(unwrapped(qs[joint]).T, lower, upper).T
    return ConstantRolls(least, first, branches, margins[branches, rolls], qs)


def constant_roll_margins(grid: RollGrid, branch: int) -> Floats:
    """Return the margins (R, n) of constant rolls on one branch, with jumps and whole turns.

    A joint that may make full turns is followed from its start; it has to fit as a whole.
    """
    limits, margin_limits = grid.model.limits, grid.margin_limits
    margins = grid.margins[branch].copy()
    widest = np.zeros((margins.shape[0], max(0, margins.shape[1] - 1)))
    for joint in range(6):
        q = grid.qs_rad[branch, joint]
        steps = np.diff(q, axis=1)
        if grid.turning[joint]:
            turns = np.round(steps / TURN_RAD)
            steps -= TURN_RAD * turns
            lower, upper = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
            shifted = shift_to_fit(_turned(q, turns).T, lower, upper).T
            off_middle = np.abs(shifted - (lower + upper) / 2.0)
            limit = ((upper - lower) / 2.0 - off_middle) / margin_limits.limit_unit_rad
            np.minimum(margins, limit, out=margins)
        np.maximum(widest, np.abs(steps, out=steps), out=widest)
    jump = (margin_limits.step_rad - widest) / margin_limits.step_unit_rad
    np.minimum(margins[:, 1:], jump, out=margins[:, 1:])
    # the first sample has no step that leads to it
    at_rest = margin_limits.step_rad / margin_limits.step_unit_rad
    return np.minimum(margins, at_rest, out=margins)


def unwrapped(angles_rad: Floats) -> Floats:
    """Return angles (..., n) made continuous along the last axis; the first stays."""
    return _turned(angles_rad, np.round(np.diff(angles_rad, axis=-1) / TURN_RAD))


def _turned(angles_rad: Floats, turns: Floats) -> Floats:
    """Return angles (R, n) less the full turns (R, n - 1) that were made before them."""
    rows = np.flatnonzero(turns.any(axis=-1))
    result = angles_rad.copy()
    result[rows, 1:] -= TURN_RAD * np.cumsum(turns[rows], axis=-1)
    return result


def best_branch(margins: Floats, first: Ints) -> int:
    """Return the branch with the largest margin, or the one that gets furthest if all fail.

    Mirrored branches often have the same margin; then the first counts, not the last digit.

    Args:
        margins: Least margin (8,).
        first: Path point (8,) that fails first, the number of points where none does.
    """
    even = np.round(margins, EVEN_DIGITS)
    if even.max() >= 0.0:
        return int(np.argmax(even))
    return max(range(len(even)), key=lambda branch: (int(first[branch]), float(even[branch])))
