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
    TABLES,
    ConvexBody,
    collision_bodies,
)
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Obstacle, Obstacles
from rona_core.robot.kinematics.arm import as_joints
from rona_core.robot.kinematics.robot_model import RobotModel

POSITIONS = 100  # in which parts that may be far from each other are tried
FAR_MM = 60.0  # parts that stay farther apart are never near
ROUNDED = 6  # decimals of a distance: where the search for it started must not show
MOVING = 2  # obstacles matter from this link on: base and shoulder stay where they are
ITSELF = "the robot itself"


@dataclass(frozen=True, slots=True, eq=False)
class CollisionReport:
    """How close the robot comes to anything at each of n places, and which parts do."""

    names: tuple[tuple[str, str], ...]  # the pairs that are looked at: part, and part or obstacle
    least_mm: Floats  # (p,) how far each pair must keep apart
    clearance_mm: Floats  # (n,) least distance of any pair, those that may touch left out
    room_mm: Floats  # (n,) least distance beyond what is demanded; negative: too close
    closest: Ints  # (n,) the pair with the least room
    closest_mm: Floats  # (p,) least distance of each pair over all places
    closest_at: Ints  # (p,) the place where it is that close
    first_hit: int  # the first place that is too close, -1 for none

    @property
    def clear(self) -> bool:
        """Whether no pair comes too close anywhere."""
        return self.first_hit < 0

    def sentence(self) -> str:
        """Return what comes too close first, or how much room there is."""
        at = self.first_hit if self.first_hit >= 0 else int(np.argmin(self.room_mm))
        pair = int(self.closest[at])
        first, second = self.names[pair]
        distance = self.least_mm[pair] + self.room_mm[at]
        words = f"{first} and {second} are {distance:.1f} mm apart at sample {at}"
        return f"{words}, {self.least_mm[pair]:.0f} mm must be kept"


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

        Of an arm without a table of its own, parts that are too close at rest already are taken
        as built that way.
        """
        pairs = _own_pairs(model, bodies, self.obstacles.self_margin_mm)
        if model.name in TABLES:
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

    def clearance_mm(self, qs_rad: ArrayLike) -> Floats:
        """Return the least distance of any pair that must not touch, (n,); negative inside."""
        return self.report(qs_rad).clearance_mm

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
            names=tuple((pair.first, pair.second) for pair in self.pairs),
            least_mm=readonly(self.least_mm.copy()),
            clearance_mm=readonly(distances[:, self._counted].min(axis=1)),
            room_mm=readonly(room),
            closest=readonly(rooms.argmin(axis=1).astype(np.int64)),
            closest_mm=readonly(distances.min(axis=0)),
            closest_at=readonly(distances.argmin(axis=0).astype(np.int64)),
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
    poses = [model.joint_poses(q) for q in qs]
    rotations = np.stack([pose.rotations for pose in poses])
    places = np.stack([pose.translations for pose in poses])
    found: list[bool] = []
    for pair in candidates:
        centers, reach_mm = [], 0.0
        for body in pair:
            center = 0.5 * (body.vertices.min(axis=0) + body.vertices.max(axis=0))
            centers.append(rotations[:, body.link] @ center + places[:, body.link])
            reach_mm += float(np.linalg.norm(body.vertices - center, axis=1).max()) + body.radius_mm
        gap_mm = np.linalg.norm(centers[0] - centers[1], axis=1).min() - reach_mm
        found.append(bool(gap_mm < FAR_MM))
    return found


def require_clear(
    model: RobotModel, obstacles: Obstacles, q_rad: Floats, where: str = "is to go"
) -> None:
    """Raise NotReachableError where the robot touches something, or comes close, at (6,) angles."""
    report = CollisionWorld(model, obstacles).report(q_rad[None])
    if not report.clear:
        pair = int(report.closest[0])
        (first, second), least_mm = report.names[pair], float(report.least_mm[pair])
        raise NotReachableError(
            f"where the robot {where}, {first} and {second} are "
            f"{least_mm + float(report.room_mm[0]):.0f} mm apart, {least_mm:.0f} mm must be kept"
        )


def clear_among(model: RobotModel, obstacles: Obstacles) -> Clear:
    """Return what tells for joint angles (n, 6) where nothing comes too close to anything."""
    return CollisionWorld(model, obstacles).clear
