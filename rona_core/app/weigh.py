"""Weigh the tool before a scan: a few free poses around where the robot stands."""

import numpy as np

from rona_core.app.toolbox import Toolbox
from rona_core.arrays import Floats
from rona_core.devices.force import ToolLoad
from rona_core.errors import CancelledError, NotReachableError
from rona_core.robot.model import RobotModel
from rona_core.robot.motion import plan_joint_move
from rona_core.robot.tool_load import fit_tool_load
from rona_core.robot.verify import verify_motion

# Turns of joints 4 to 6 in degrees, about two axes, so that weight and offset can be told apart.
TURNS_DEG = ((0, 0, 0), (0, 25, 0), (0, -25, 0), (0, 0, 35), (0, 0, -35), (20, 15, 20))
SETTLE_S = 0.1
READINGS = 12
PERIOD_S = 0.016


def weigh_tool(q_rest_rad: Floats, model: RobotModel, tools: Toolbox) -> ToolLoad:
    """Return the load on the force sensor; the robot ends where it stood, at ``q_rest_rad`` (6,).

    A pose that the joints do not allow is turned the other way, or left out.

    Raises:
        DegenerateGeometryError: the poses that are left do not tell weight and offset apart.
        CancelledError: somebody pressed Cancel or Stop on the way.
    """
    rotations: list[Floats] = []
    wrenches: list[Floats] = []
    here = q_rest_rad
    for turn in TURNS_DEG:
        for sign in (1.0, -1.0):
            goal = q_rest_rad + np.concatenate((np.zeros(3), sign * np.deg2rad(turn)))
            if _go(here, goal, model, tools):
                here = goal
                wrenches.append(_mean_wrench(tools))
                rotations.append(model.forward(goal[None])[0].rotation)
                break
    if not _go(here, q_rest_rad, model, tools):
        raise NotReachableError("the robot cannot return from weighing the tool")
    return fit_tool_load(np.array(rotations).reshape(-1, 3, 3), np.array(wrenches).reshape(-1, 6))


def _go(here: Floats, goal: Floats, model: RobotModel, tools: Toolbox) -> bool:
    """Move on a certified motion; return False where there is none."""
    if np.array_equal(here, goal):
        return True
    try:
        planned = plan_joint_move(here, goal, model)
    except NotReachableError:
        return False
    if not verify_motion(model, planned).certifies(planned):
        return False
    rig = tools.rig
    motion = rig.robot.move(planned.times_s, planned.qs_rad)
    arrival_s = rig.clock.now() + planned.duration_s
    while not motion.done():
        if tools.cancel():
            rig.robot.stop()
            raise CancelledError("the robot was stopped while the tool was weighed")
        rig.clock.wait_until(min(rig.clock.now() + 0.1, arrival_s))
        tools.live.put(joints=rig.robot.state())
    return True


def _mean_wrench(tools: Toolbox) -> Floats:
    clock = tools.rig.clock
    start_s = clock.now() + SETTLE_S
    readings: list[Floats] = []
    for i in range(READINGS):
        clock.wait_until(start_s + i * PERIOD_S)
        readings.append(tools.rig.force.read().wrench)
    return np.array(readings).mean(axis=0)
