"""Collision-free joint paths from one place to another.

First the straight move, then a few detours that usually do (up and over, by way of home), then
RRT-Connect. See docs/algorithms/robot/collision_free_moves.md.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.edge_check import MOST_CHECKS, Checker, Clear
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.rrt_connect import search, shortened

LIFTS_MM = (100.0, 200.0, 300.0)
LIFT_STEP_MM = 20.0
LARGEST_LIFT_STEP_RAD = float(np.deg2rad(30.0))  # more is another branch of the arm


def plan_joint_path(
    q_from_rad: Floats,
    q_to_rad: Floats,
    model: RobotModel,
    clear: Clear,
    *,
    seed: int = 0,
    most_checks: int = MOST_CHECKS,
) -> Floats:
    """Return joint angles (k, 6) to move through, straight in between, all of it clear.

    Args:
        q_from_rad: Joint angles (6,) where the robot stands.
        q_to_rad: Joint angles (6,) to go to.
        model: The robot.
        clear: Tells for joint angles (n, 6) where nothing is touched.
        seed: Of the search, where one is needed; the same seed finds the same way.
        most_checks: Places looked at before the search gives up.

    Raises:
        NotReachableError: start or goal touch something, or no way was found in time.
    """
    checker = Checker(model, clear, most_checks)
    for name, q in (("stands", q_from_rad), ("is to go", q_to_rad)):
        if not checker.place(q):
            raise NotReachableError(f"where the robot {name} it touches something or comes close")
    share = checker.clear_share(q_from_rad, q_to_rad)
    if share == 1.0:
        return np.stack((q_from_rad, q_to_rad))
    for vias in _usual_ways(model, q_from_rad, q_to_rad):
        if checker.spent:
            break
        stops = np.stack((q_from_rad, *vias, q_to_rad))
        if all(checker.move(a, b) for a, b in pairwise(stops)):
            return stops
    found = search(q_from_rad, q_to_rad, checker, seed)
    if found is None:
        raise NotReachableError(
            f"no way to the goal without touching something was found among {checker.checks} "
            f"places; the straight move is clear for its first {100.0 * share:.0f} %",
            clear_share=share,
        )
    return shortened(found, checker, seed)


def _usual_ways(model: RobotModel, q_from: Floats, q_to: Floats) -> Sequence[tuple[Floats, ...]]:
    """Return places to go by, the shortest detours first."""
    lifted_from, lifted_to = raised(model, q_from), raised(model, q_to)
    ways: list[tuple[Floats, ...]] = []
    for i in range(len(LIFTS_MM)):
        over = [lifts[i] for lifts in (lifted_from, lifted_to) if i < len(lifts)]
        ways += [(via,) for via in over]
        if len(over) == 2:
            ways.append((over[0], over[1]))
    ways.append((model.home_rad,))
    ways += [(via, model.home_rad) for via in lifted_from]
    ways += [(model.home_rad, via) for via in lifted_to]
    return ways


def raised(model: RobotModel, q_rad: Floats) -> list[Floats]:
    """Return joint angles (6,) with the tool lifted straight up by ``LIFTS_MM``, while it can be.

    The tool keeps its orientation and the arm its branch.
    """
    T_base_flange = model.forward(q_rad[None])[0]
    heights_mm = np.arange(LIFT_STEP_MM, LIFTS_MM[-1] + LIFT_STEP_MM / 2.0, LIFT_STEP_MM)
    places = T_base_flange.translation + heights_mm[:, None] * np.array((0.0, 0.0, 1.0))
    rotations = np.repeat(T_base_flange.rotation[None], len(places), axis=0)
    qs = model.follow(Poses(rotations, places), q_rad, LARGEST_LIFT_STEP_RAD)
    reached_mm = heights_mm[: len(qs)]
    return [q for q, height_mm in zip(qs, reached_mm, strict=True) if height_mm in LIFTS_MM]
