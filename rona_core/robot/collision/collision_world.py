"""Does the robot come too close to anything, itself included?

See docs/algorithms/robot/collision.md.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.robot.collision.coal_geometry import Bodies, Pair
from rona_core.robot.collision.collision_geometry import (
    DELAY_LINE,
    HELD_APART,
    PROBE,
    PROBE_BODY,
    ConvexBody,
    collision_bodies,
)
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Obstacle, Obstacles
from rona_core.robot.kinematics.arm import as_joints
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.kinematics.spherical_wrist import SphericalWristArm

POSITIONS = 100  # in which parts that may be far from each other are tried
FAR_MM = 60.0  # parts that stay farther apart are never near
ROUNDED = 6  # decimals of a distance: where the search for it started must not show
MOVING = 2  # obstacles matter from this link on: base and shoulder stay where they are
ITSELF = "the robot itself"


@dataclass(frozen=True, slots=True)
class ClosestPair:
    """Two parts of the robot, or a part and an obstacle, and how far apart they are."""

    first: str
    second: str
    apart_mm: float  # negative inside
    least_mm: float  # that must be kept


@dataclass(frozen=True, slots=True, eq=False)
class CollisionReport:
    """How close the robot comes to anything at each of n places, and which parts do."""

    pairs: tuple[Pair, ...]  # that are looked at
    clearance_mm: Floats  # (n,) least distance of any pair, those that may touch left out
    room_mm: Floats  # (n,) least distance beyond what is demanded; negative: too close
    closest: Ints  # (n,) the pair with the least room
    first_hit: int  # the first place that is too close, -1 for none

    def closest_pair(self, place: int) -> ClosestPair:
        """Return the pair with the least room at one place."""
        pair = self.pairs[self.closest[place]]
        apart_mm = pair.least_mm + float(self.room_mm[place])
        return ClosestPair(pair.first, pair.second, apart_mm, pair.least_mm)


class CollisionWorld:
    """Robot, tool and what stands around them, as convex bodies.

    Attributes:
        obstacles: What stands around.
        pairs: The parts that can meet, and how far each two must keep apart.
        least_mm: That distance of every pair, (p,).
        levers_mm: How far any part can be from each joint axis at most, (6,).
    """

    def __init__(self, model: RobotModel, obstacles: Obstacles = NOTHING_AROUND) -> None:
        """Build the bodies and find the pairs that can meet."""
        self.obstacles = obstacles
        bodies = collision_bodies(model)
        self._bodies = Bodies(model, bodies, obstacles.things)
        self.pairs = (
            *self._own_pairs(model, bodies),
            *(
                pair
                for thing in obstacles.things
                if self._bodies.within_reach(thing)
                for pair in _pairs_with(thing, bodies)
            ),
        )
        self._bodies.look_at(self.pairs)
        self.least_mm = readonly(np.array([pair.least_mm for pair in self.pairs]))
        self.levers_mm = readonly(self._bodies.levers_mm)
        self._counted = self.least_mm >= 0.0

    def _own_pairs(self, model: RobotModel, bodies: tuple[ConvexBody, ...]) -> list[Pair]:
        """Return which parts of the robot can meet.

        Of an arm bounded by hulls of its solids, parts that are too close at rest already are
        taken as built that way.
        """
        pairs = _own_pairs(model, bodies, self.obstacles.self_margin_mm)
        if isinstance(model.arm, SphericalWristArm):
            return pairs
        self._bodies.look_at(tuple(pairs))
        apart_mm = self._bodies.distances_mm(model.home_rad)
        return [
            pair
            for pair, distance in zip(pairs, apart_mm, strict=True)
            if distance >= pair.least_mm
        ]

    def clear(self, qs_rad: ArrayLike) -> Bools:
        """Return at which joint angles (n, 6) everything keeps its distance, (n,)."""
        qs = as_joints(qs_rad)
        return np.array([not self._bodies.meets(q) for q in qs], dtype=np.bool_)

    def distances_mm(self, qs_rad: ArrayLike) -> Floats:
        """Return the distance of every pair (n, p) at joint angles (n, 6)."""
        qs = as_joints(qs_rad)
        found = np.zeros((len(qs), len(self.pairs)))
        for i, q in enumerate(qs):
            found[i] = self._bodies.distances_mm(q)
        return np.round(found, ROUNDED)

    def report(self, qs_rad: ArrayLike) -> CollisionReport:
        """Return who comes how close to what at joint angles (n, 6), n at least 1."""
        distances = self.distances_mm(qs_rad)
        rooms = distances - self.least_mm
        room = rooms.min(axis=1)
        hits = np.flatnonzero(room < 0.0)
        return CollisionReport(
            pairs=self.pairs,
            clearance_mm=readonly(distances[:, self._counted].min(axis=1)),
            room_mm=readonly(room),
            closest=readonly(rooms.argmin(axis=1).astype(np.int64)),
            first_hit=int(hits[0]) if len(hits) else -1,
        )


def _own_pairs(model: RobotModel, bodies: tuple[ConvexBody, ...], least_mm: float) -> list[Pair]:
    """Return which parts of the robot can meet: two joints apart at least, and not held apart."""
    held = HELD_APART.get(model.name, ())
    parts = [body for body in bodies if body.name not in (DELAY_LINE, PROBE_BODY)]
    candidates = [
        (a, b)
        for i, a in enumerate(parts)
        for b in parts[i + 1 :]
        if b.link - a.link >= 2 and (a.name, b.name) not in held
    ]
    near = _ever_near(model, candidates)
    return [
        Pair(a.name, b.name, ITSELF, least_mm)
        for (a, b), meets in zip(candidates, near, strict=True)
        if meets or b.link - a.link > 2
    ]


def _pairs_with(thing: Obstacle, bodies: tuple[ConvexBody, ...]) -> list[Pair]:
    """Return the parts that an obstacle has to be looked at with."""
    apart = (PROBE,) if thing.touch_mm else (PROBE_BODY, DELAY_LINE)
    parts = [body for body in bodies if body.link >= MOVING and body.name not in apart]
    return [
        Pair(
            part.name,
            thing.name,
            thing.name,
            -thing.touch_mm if part.name == DELAY_LINE else thing.margin_mm,
        )
        for part in parts
    ]


def _ever_near(model: RobotModel, candidates: list[tuple[ConvexBody, ConvexBody]]) -> list[bool]:
    """Return which parts can come near each other; for parts with one joint between them.

    Their distance depends on few joints, so that some hundred positions tell how it varies.
    """
    rng = np.random.default_rng(0)
    qs = rng.uniform(model.lower_rad, model.upper_rad, (POSITIONS, len(model.lower_rad)))
    rotations, places = model.arm.link_frames(qs)
    found: list[bool] = []
    for pair in candidates:
        centers, reach_mm = [], 0.0
        for body in pair:
            center = 0.5 * (body.vertices.min(axis=0) + body.vertices.max(axis=0))
            centers.append(rotations[:, body.link] @ center + places[:, body.link])
            reach_mm += float(np.linalg.norm(body.vertices - center, axis=1).max())
        gap_mm = np.linalg.norm(centers[0] - centers[1], axis=1).min() - reach_mm
        found.append(bool(gap_mm < FAR_MM))
    return found


def require_clear(
    model: RobotModel, obstacles: Obstacles, q_rad: Floats, where: str = "is to go"
) -> None:
    """Raise NotReachableError where the robot touches something, or comes close, at (6,) angles."""
    report = CollisionWorld(model, obstacles).report(q_rad[None])
    if report.first_hit >= 0:
        pair = report.closest_pair(0)
        raise NotReachableError(
            f"where the robot {where}, {pair.first} and {pair.second} are "
            f"{pair.apart_mm:.0f} mm apart, {pair.least_mm:.0f} mm must be kept"
        )
