"""Clearance checks of the verifier: every obstacle, over the whole motion, samples and between.

At each sample the least distance from every obstacle is known. On the way to the next one no point
of the robot moves farther than the joint steps times the longest levers. Where that is less than
the room at both ends together, nothing can touch in between; elsewhere the step is halved, and
halved again.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.robot.collision.collision_world import ITSELF, CollisionWorld
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.verification.certificate import Check
from rona_core.robot.verification.motion_checks import DenseMotion, check
from rona_core.robot.verification.tolerances import DENSITY, HALVINGS


@dataclass(frozen=True, slots=True, eq=False)
class _Nearest:
    """Where each pair of parts is nearest: of a whole motion, all distances take much memory."""

    distances_mm: Floats  # (p,)
    numbers: Floats  # (p,) of the samples there, the first of equals in the order they came

    @classmethod
    def of(cls, distances: Floats, numbers: Floats) -> "_Nearest":
        """Return it of distances (k, p) at samples (k,)."""
        rows = np.array([of_pair.argmin() for of_pair in distances.T], dtype=np.int64)  # no copy
        return cls(distances[rows, np.arange(len(rows))], numbers[rows])

    def or_nearer(self, later: "_Nearest") -> "_Nearest":
        """Return what is nearer, pair by pair, here or at later places."""
        nearer = later.distances_mm < self.distances_mm
        return _Nearest(
            np.where(nearer, later.distances_mm, self.distances_mm),
            np.where(nearer, later.numbers, self.numbers),
        )


def clearance(
    model: RobotModel, dense: DenseMotion, obstacles: Obstacles
) -> tuple[list[Check], float | None]:
    """Check the whole motion against every obstacle, and the robot against itself.

    It is looked at afresh: nothing of what a planner found is used. Also return the least distance
    of parts that must not touch; None where there is no such pair.
    """
    world = CollisionWorld(model, obstacles)
    return judged(world, _nearest(world, dense))


def _nearest(world: CollisionWorld, dense: DenseMotion) -> _Nearest:
    """Return where each pair is nearest, of all places that are looked at."""
    qs, numbers = dense.qs_rad[::DENSITY], dense.numbers[::DENSITY]
    found = world.nearest_mm(qs)
    room = _room_mm(world, found)
    nearest = _Nearest.of(found, numbers)
    ends = [(qs[:-1], qs[1:]), (room[:-1], room[1:]), (numbers[:-1], numbers[1:])]
    del found  # it is large
    for _ in range(HALVINGS):
        (q_from, q_to), (room_from, room_to), (first, last) = ends
        moved_mm = np.abs(q_to - q_from) @ world.levers_mm
        near = (room_from + room_to <= moved_mm) & (np.minimum(room_from, room_to) >= 0.0)
        if not near.any():
            break
        q_mid, middle = 0.5 * (q_from + q_to)[near], 0.5 * (first + last)[near]
        found = world.nearest_mm(q_mid)
        room_mid = _room_mm(world, found)
        nearest = nearest.or_nearer(_Nearest.of(found, middle))
        ends = [
            (np.concatenate((low[near], mid)), np.concatenate((mid, high[near])))
            for (low, high), mid in zip(ends, (q_mid, room_mid, middle), strict=True)
        ]
    return nearest


def _room_mm(world: CollisionWorld, distances: Floats) -> Floats:
    """Return the least distance (k,) beyond what is demanded, of distances (k, p)."""
    room = np.full(len(distances), np.inf)
    for of_pair, least in zip(distances.T, world.least_mm, strict=True):  # a difference is large
        np.minimum(room, of_pair - least, out=room)
    return room


def judged(world: CollisionWorld, nearest: _Nearest) -> tuple[list[Check], float | None]:
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
                checks.append(_worst(f"{words} {group}", world, columns, nearest))
    counted = np.flatnonzero(world.least_mm >= 0.0).tolist()
    return checks, min((float(nearest.distances_mm[pair]) for pair in counted), default=None)


def _worst(name: str, world: CollisionWorld, columns: Ints, nearest: _Nearest) -> Check:
    """Return the check of the pair, of those in some columns, that is closest."""
    rooms = nearest.distances_mm[columns] - world.least_mm[columns]
    column = columns[rooms.argmin()]
    pair = world.pairs[int(column)]
    return check(
        name,
        nearest.distances_mm[column][None],
        pair.least_mm,
        "mm",
        least=True,
        first=int(nearest.numbers[column]),
        remark=f" between {pair.first} and {pair.second}",
    )
