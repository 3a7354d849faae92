"""Weigh the tool before a scan: a few free poses around where the robot stands."""

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.steps.tool.robot_motion import FreeMoves
from rona_core.devices.wrench import ToolLoad
from rona_core.errors import CancelledError, DegenerateGeometryError, NotReachableError
from rona_core.geometry.arrays import Floats
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.force_control.gravity_compensation import fit_tool_load
from rona_core.robot.kinematics.robot_model import RobotModel

# Turns of joints 4 to 6 in degrees, about two axes, so that weight and offset can be separated.
TURNS_DEG = ((0, 0, 0), (0, 25, 0), (0, -25, 0), (0, 0, 35), (0, 0, -35), (20, 15, 20))
SETTLE_S = 0.1
READINGS = 12
PERIOD_S = 0.016
STOPPED = (
    "the robot was stopped while the tool was weighed, before the probe came near the bone: no "
    "A-scan was recorded, and an earlier scan is kept"
)


def identify_payload(
    q_rest_rad: Floats, model: RobotModel, around: Obstacles, context: ActivityContext
) -> ToolLoad:
    """Return the load on the force sensor; the robot ends where it stood, at ``q_rest_rad`` (6,).

    A pose that the joints or something in the way do not allow is turned the other way, or left
    out. Every move is planned and certified among what stands around.

    Raises:
        DegenerateGeometryError: the poses that are left do not tell weight and offset apart; it
            says what stood in the way of the others.
        NotReachableError: the robot stands where it touches something, or cannot return.
        CancelledError: Cancel or Stop was pressed on the way.
    """
    moves = FreeMoves(model, around)
    rotations: list[Floats] = []
    wrenches: list[Floats] = []
    left_out: list[str] = []
    here = q_rest_rad
    for turn in TURNS_DEG:
        for sign in (1.0, -1.0):
            goal = q_rest_rad + np.concatenate((np.zeros(3), sign * np.deg2rad(turn)))
            try:
                _go(here, goal, moves, context)
            except NotReachableError as error:
                left_out.append(str(error))
                continue
            here = goal
            wrenches.append(_mean_wrench(context))
            rotations.append(model.forward(goal[None])[0].rotation)
            break
    _go(here, q_rest_rad, moves, context)
    try:
        return fit_tool_load(
            np.array(rotations).reshape(-1, 3, 3), np.array(wrenches).reshape(-1, 6)
        )
    except DegenerateGeometryError as error:
        if not left_out:
            raise
        ways = "; ".join(dict.fromkeys(left_out))
        raise DegenerateGeometryError(
            f"{error}. The robot could not turn it every way: {ways}"
        ) from error


def _go(here: Floats, goal: Floats, moves: FreeMoves, context: ActivityContext) -> None:
    """Move on motions that are certified among what stands around.

    Raises:
        NotReachableError: there is none; it says why.
        CancelledError: Cancel or Stop was pressed on the way.
    """
    if np.array_equal(here, goal):
        return
    rig = context.rig
    for planned in moves.plan(here, goal):
        if context.cancel():
            raise CancelledError(STOPPED)
        motion = rig.robot.move(planned.times_s, planned.qs_rad)
        arrival_s = rig.clock.now() + planned.duration_s
        while not motion.done():
            if context.cancel():
                rig.robot.stop()
                raise CancelledError(STOPPED)
            rig.clock.wait_until(min(rig.clock.now() + 0.1, arrival_s))
            context.live.put(joints=rig.robot.state())


def _mean_wrench(context: ActivityContext) -> Floats:
    clock = context.rig.clock
    start_s = clock.now() + SETTLE_S
    readings: list[Floats] = []
    for i in range(READINGS):
        clock.wait_until(start_s + i * PERIOD_S)
        readings.append(context.rig.force.read().wrench)
    return np.array(readings).mean(axis=0)
