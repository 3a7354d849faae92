"""Say how far a varying roll leads, and what stops it."""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.joint_limits import TURN_RAD
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.cost import RollCost, strides_of
from rona_core.robot.redundancy.infeasibility import Blame, blame, failing, passing, posture_of
from rona_core.robot.redundancy.margins import RoomRules, singular_room
from rona_core.robot.redundancy.result import RollCurve, RollVerdict
from rona_core.robot.redundancy.roll_grid import RollGrid, flange_parts, follow_poses, reach_room
from rona_core.robot.redundancy.variable.lattice import band_of
from rona_core.robot.redundancy.variable.optimal_roll import NoWay

NAME = "varying roll"
SLIGHT = 1e-9  # room that is missing where a way ends, at least


def varying_verdict(
    found: RollCurve | NoWay,
    path: Path5D,
    model: RobotModel,
    grid: RollGrid,
    rules: RoomRules,
    cost: RollCost,
    blocked: Bools | None = None,
) -> RollVerdict:
    """Return the verdict on a varying roll: its least room, or how far the path can be followed."""
    if isinstance(found, RollCurve):
        room = curve_room(found, path, model, rules)
        index = int(np.argmin(room))
        roll_deg = float(np.rad2deg(found.rolls_rad[index]))
        least = float(room[index])
        turned_deg = float(np.rad2deg(np.ptp(found.rolls_rad)))
        name = f"{NAME} over {turned_deg:.0f}°"
        return passing(name, roll_deg, found.branch, least, index)
    if found.spun is not None:
        return _spun(found.spun, path, model, rules)
    return _stopped(found, path, model, grid, rules, cost, blocked)


def curve_room(curve: RollCurve, path: Path5D, model: RobotModel, rules: RoomRules) -> Floats:
    """Return the least room (n,) of a roll curve: reach, singularities, limits and jumps."""
    solutions = model.inverse(follow_poses(flange_parts(path, model), curve.rolls_rad))
    limits = model.limits.clearance_rad(curve.qs_rad).min(axis=1) / rules.limit_unit_rad
    steps = np.abs(np.diff(curve.qs_rad, axis=0, prepend=curve.qs_rad[:1])).max(axis=1)
    return np.minimum.reduce(
        (
            reach_room(solutions, rules)[:, curve.branch],
            singular_room(solutions, rules)[:, curve.branch],
            limits,
            (rules.step_rad - steps) / rules.step_unit_rad,
        )
    )


def _spun(spun: RollCurve, path: Path5D, model: RobotModel, rules: RoomRules) -> RollVerdict:
    """Blame the joint that runs out of turns on a way that keeps every other rule."""
    clearance = model.limits.clearance_rad(spun.qs_rad).min(axis=1)
    index = int(np.argmax(clearance < 0.0))
    solutions = model.inverse(follow_poses(flange_parts(path, model), spun.rolls_rad))
    steps = np.diff(spun.qs_rad, axis=0, prepend=spun.qs_rad[:1])
    posture = posture_of(solutions, index, spun.branch, spun.qs_rad[index], steps[index])
    margin = float(clearance.min()) / rules.limit_unit_rad
    roll_deg = float(np.rad2deg(spun.rolls_rad[index]))
    cause = blame(posture, model.limits, rules)
    return failing(_at_roll(roll_deg), roll_deg, spun.branch, margin, index, len(path), cause)


def _stopped(
    found: NoWay,
    path: Path5D,
    model: RobotModel,
    grid: RollGrid,
    rules: RoomRules,
    cost: RollCost,
    blocked: Bools | None,
) -> RollVerdict:
    """Blame what stops the posture with the most room among those next to the last reached."""
    index, count, band = found.furthest + 1, len(grid.rolls_rad), band_of(grid)
    near = found.frontier.copy() if index else np.ones_like(found.frontier)
    for shift in range(-band, band + 1) if index else ():
        moved = np.roll(found.frontier, shift, axis=1)
        if not grid.closed and shift:
            moved[:, : max(0, shift)] = False
            moved[:, count + min(0, shift) :] = False
        near |= moved
    room = grid.room[:, :, index]
    shut = np.zeros_like(near) if blocked is None else blocked[index].T
    good = near & (room >= 0.0)
    free, barred = good & ~shut, good & shut
    pool = free if free.any() else barred if barred.any() else near
    best = np.unravel_index(int(np.argmax(np.where(pool, room, -np.inf))), room.shape)
    branch, roll = int(best[0]), int(best[1])
    roll_deg = float(np.rad2deg(grid.rolls_rad[roll]))
    if free.any() and index:
        margin, cause = _step_blame(found, grid, rules, cost, path, (branch, roll, index))
    elif barred.any():
        count = int(barred.sum())
        words = f"all {count} postures that the arm allows touch something or cannot be left"
        margin, cause = 0.0, Blame("blocked", 0, float(count), 0.0, "", words)
    else:
        rolls = np.full(len(path), grid.rolls_rad[roll])
        solutions = model.inverse(follow_poses(flange_parts(path, model), rolls))
        q = _turned_to_suit(grid.qs_rad[branch, :, roll, index], model, grid.turning)
        posture = posture_of(solutions, index, branch, q, np.zeros(6))
        margin, cause = float(room[branch, roll]), blame(posture, model.limits, rules)
    return failing(
        _at_roll(roll_deg), roll_deg, branch, min(margin, -SLIGHT), index, len(path), cause
    )


def _step_blame(
    found: NoWay,
    grid: RollGrid,
    rules: RoomRules,
    cost: RollCost,
    path: Path5D,
    place: tuple[int, int, int],
) -> tuple[float, Blame]:
    """Blame the step to a posture that is allowed by itself."""
    branch, roll, index = place
    before = np.flatnonzero(found.frontier[branch])
    steps = grid.qs_rad[branch, :, roll, index] - grid.qs_rad[branch][:, before, index - 1].T
    steps -= TURN_RAD * np.where(grid.turning, np.round(steps / TURN_RAD), 0.0)
    nearest = int(np.argmin(np.abs(steps).max(axis=1)))
    widest = float(np.abs(steps[nearest]).max())
    if widest > rules.step_rad:
        joint = int(np.argmax(np.abs(steps[nearest])))
        value_deg, limit_deg = np.rad2deg((widest, rules.step_rad)).tolist()
        words = f"joint {joint + 1} would jump by {value_deg:.1f}°, {limit_deg:.0f}° are allowed"
        room = (rules.step_rad - widest) / rules.step_unit_rad
        return room, Blame("jump", joint + 1, value_deg, limit_deg, "deg", words)
    allowed = np.rad2deg(float(cost.largest_roll_rad(strides_of(path)[index - 1 : index])[0]))
    wanted = np.rad2deg(grid.spacing_rad)
    words = f"the roll would have to change by {wanted:.1f}°, {allowed:.1f}° are allowed"
    return -1.0, Blame("roll rate", 0, float(wanted), float(allowed), "deg", words)


def _turned_to_suit(q_rad: Floats, model: RobotModel, turning: Bools) -> Floats:
    """Return a posture (6,) whose joints with turns stand as near the middle as they can."""
    middle = (model.lower_rad + model.upper_rad) / 2.0
    turns = np.round((middle - q_rad) / TURN_RAD)
    return q_rad + TURN_RAD * np.where(turning, turns, 0.0)


def _at_roll(roll_deg: float) -> str:
    return f"{NAME}, there {roll_deg:.4g}°"
