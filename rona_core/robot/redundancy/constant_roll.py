"""Judge every roll on every branch at once: least room, where it is, and where it first fails."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.robot.kinematics.joint_limits import TURN_RAD, JointLimits, shift_to_fit
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.margins import EVEN_DIGITS, RoomRules
from rona_core.robot.redundancy.roll_grid import RollGrid


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """What became of each constant roll; R rolls, n path points."""

    margins: Floats  # (8, R) least room along the path
    first: Ints  # (8, R) path point that fails first; n where none does
    branches: Ints  # (R,) the branch with the most room, or the one that gets furthest
    least: Floats  # (R, n) room of that branch, with what the way there demands
    qs_rad: Floats  # (6, R, n) that branch, continuous, turned so that it fits its limits


def sweep(grid: RollGrid, model: RobotModel, rules: RoomRules) -> Sweep:
    """Judge all rolls of a grid on all branches."""
    n_branches, count, n = grid.room.shape
    least = np.zeros((n_branches, count, n))
    for branch in range(n_branches):
        least[branch] = column_room(grid, branch, model.limits, rules)
    margins = least.min(axis=2)
    failing = least < 0.0
    first = np.where(margins < 0.0, failing.argmax(axis=2), n)
    branches = np.array([best_branch(margins[:, i], first[:, i]) for i in range(count)], np.int64)
    rolls = np.arange(count)
    qs = np.ascontiguousarray(grid.qs_rad[branches, :, rolls].transpose(1, 0, 2))
    for joint in np.flatnonzero(grid.turning):
        lower, upper = float(model.lower_rad[joint]), float(model.upper_rad[joint])
        qs[joint] = shift_to_fit(unwrapped(qs[joint]).T, lower, upper).T
    return Sweep(margins, first, branches, least[branches, rolls], qs)


def column_room(grid: RollGrid, branch: int, limits: JointLimits, rules: RoomRules) -> Floats:
    """Return the room (R, n) of constant rolls on one branch, jumps and turns taken into account.

    A joint that may make full turns is followed from its start; it has to fit as a whole.
    """
    room = grid.room[branch].copy()
    widest = np.zeros((room.shape[0], max(0, room.shape[1] - 1)))
    for joint in range(6):
        q = grid.qs_rad[branch, joint]
        steps = np.diff(q, axis=1)
        if grid.turning[joint]:
            turns = np.round(steps / TURN_RAD)
            steps -= TURN_RAD * turns
            lower, upper = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
            shifted = shift_to_fit(_turned(q, turns).T, lower, upper).T
            away = np.abs(shifted - (lower + upper) / 2.0)
            np.minimum(room, ((upper - lower) / 2.0 - away) / rules.limit_unit_rad, out=room)
        np.maximum(widest, np.abs(steps, out=steps), out=widest)
    jump = (rules.step_rad - widest) / rules.step_unit_rad
    np.minimum(room[:, 1:], jump, out=room[:, 1:])
    # the first sample has no step that leads to it
    return np.minimum(room, rules.step_rad / rules.step_unit_rad, out=room)


def unwrapped(angles_rad: Floats) -> Floats:
    """Return angles (..., n) made continuous along the last axis; the first stays."""
    return _turned(angles_rad, np.round(np.diff(angles_rad, axis=-1) / TURN_RAD))


def _turned(angles_rad: Floats, turns: Floats) -> Floats:
    """Return angles (R, n) less the full turns (R, n - 1) that were made on the way."""
    rows = np.flatnonzero(turns.any(axis=-1))
    result = angles_rad.copy()
    result[rows, 1:] -= TURN_RAD * np.cumsum(turns[rows], axis=-1)
    return result


def best_branch(margins: Floats, first: Ints) -> int:
    """Return the branch with the most room, or the one that gets furthest if all fail.

    Mirrored branches often have the same room; then the first counts, not the last digit.

    Args:
        margins: Least room (8,).
        first: Path point (8,) that fails first, the number of points where none does.
    """
    even = np.round(margins, EVEN_DIGITS)
    if even.max() >= 0.0:
        return int(np.argmax(even))
    return max(range(len(even)), key=lambda branch: (int(first[branch]), float(even[branch])))
