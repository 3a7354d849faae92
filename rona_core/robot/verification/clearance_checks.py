"""Clearance checks of the verifier: every obstacle, over the whole motion, samples and between.

At each sample the least distance from every obstacle is known. On the way to the next one no point
of the robot moves farther than the joint steps times the longest levers. Where that is less than
the room at both ends together, nothing can touch in between; elsewhere the step is halved, and
halved again.
"""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.robot.collision.collision_world import ITSELF, CollisionWorld
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.verification.certificate import Check
from rona_core.robot.verification.motion_checks import DENSITY, DenseMotion, check

HALVINGS = 6  # of a step between samples at most


def clearance(
    model: RobotModel, dense: DenseMotion, obstacles: Obstacles
) -> tuple[list[Check], float | None]:
    """Check the whole motion against every obstacle, and the robot against itself.

    It is looked at afresh: nothing of what a planner found is used. Also return the least distance
    of parts that must not touch; None where there is no such pair.
    """
    world = CollisionWorld(model, obstacles)
    return judged(world, *_distances(world, dense))


def _distances(world: CollisionWorld, dense: DenseMotion) -> tuple[Floats, Floats]:
    """Return distances (k, p) of what is nearest where it was looked at, and the sample numbers."""
    qs, numbers = dense.qs_rad[::DENSITY], dense.numbers[::DENSITY]
    found = world.nearest_mm(qs)
    room = _room_mm(world, found)
    looked, at = [found], [numbers]
    ends = [(qs[:-1], qs[1:]), (room[:-1], room[1:]), (numbers[:-1], numbers[1:])]
    for _ in range(HALVINGS):
        (q_from, q_to), (room_from, room_to), (first, last) = ends
        moved_mm = np.abs(q_to - q_from) @ world.levers_mm
        near = (room_from + room_to <= moved_mm) & (np.minimum(room_from, room_to) >= 0.0)
        if not near.any():
            break
        q_mid, middle = 0.5 * (q_from + q_to)[near], 0.5 * (first + last)[near]
        found = world.nearest_mm(q_mid)
        room_mid = _room_mm(world, found)
        looked.append(found)
        at.append(middle)
        ends = [
            (np.concatenate((low[near], mid)), np.concatenate((mid, high[near])))
            for (low, high), mid in zip(ends, (q_mid, room_mid, middle), strict=True)
        ]
    return np.concatenate(looked), np.concatenate(at)


def _room_mm(world: CollisionWorld, distances: Floats) -> Floats:
    """Return the least distance (k,) beyond what is demanded, of distances (k, p)."""
    room = np.full(len(distances), np.inf)
    for of_pair, least in zip(distances.T, world.least_mm, strict=True):  # a difference is large
        np.minimum(room, of_pair - least, out=room)
    return room


def judged(
    world: CollisionWorld, distances: Floats, numbers: Floats
) -> tuple[list[Check], float | None]:
    """Return checks for the robot itself, for obstacles in reach, and for what may be touched."""
    checks: list[Check] = []
    for group in (ITSELF, *(thing.name for thing in world.obstacles.things)):
        clear = "clearance of" if group == ITSELF else "clearance from the"
        of_group = np.array([pair.group == group for pair in world.pairs], dtype=np.bool_)
        for words, columns in (
            (clear, np.flatnonzero(of_group & (world.least_mm >= 0.0))),
            ("touch of the", np.flatnonzero(of_group & (world.least_mm < 0.0))),
        ):
            if len(columns):  # else out of reach, or not to be touched
                checks.append(_worst(f"{words} {group}", world, columns, distances, numbers))
    counted = np.flatnonzero(world.least_mm >= 0.0).tolist()
    return checks, min((float(distances[:, pair].min()) for pair in counted), default=None)


def _worst(
    name: str, world: CollisionWorld, columns: Ints, distances: Floats, numbers: Floats
) -> Check:
    """Return the check of the pair, of those in some columns, that is closest."""
    rows = [int(distances[:, column].argmin()) for column in columns]  # a part of it is large
    rooms = distances[rows, columns] - world.least_mm[columns]
    row, column = min(zip(rooms, rows, columns, strict=True))[1:]
    pair = world.pairs[int(column)]
    return check(
        name,
        distances[row, column][None],
        pair.least_mm,
        "mm",
        least=True,
        first=int(numbers[row]),
        remark=f" between {pair.first} and {pair.second}",
    )
