"""Robot and obstacles as Pinocchio and Coal know them: the one module here that talks to Coal.

Each body moves with a joint of Pinocchio's model of the arm. Lengths are metres inside,
millimetres outside.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import compress
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_geometry import ConvexBody
from rona_core.robot.collision.obstacles import Capsule, Hull, Obstacle
from rona_core.robot.kinematics.pinocchio_model import (
    MM_PER_M,
    N_JOINTS,
    joint_placements,
    pinocchio_model,
)
from rona_core.robot.kinematics.robot_model import RobotModel

SAME = 1e-9  # m, and entries of rotations, by which link frames may differ from Pinocchio's model


@dataclass(frozen=True, slots=True)
class Pair:
    """Two bodies that are looked at, and how far they must keep apart."""

    first: str
    second: str
    group: str  # name of the obstacle, or of the robot itself
    least_mm: float  # negative where one may reach into the other


class Bodies:
    """Robot, tool and obstacles with the pairs that matter; all answers for one (6,) at a time."""

    def __init__(
        self, model: RobotModel, bodies: tuple[ConvexBody, ...], things: tuple[Obstacle, ...]
    ) -> None:
        """Build everything once; no pair is looked at until :meth:`look_at`.

        Raises:
            InvalidInputError: link frames that disagree with Pinocchio's model of the arm.
        """
        self._robot, _ = pinocchio_model(model)
        self._state = self._robot.createData()
        self._frames = frames = _frames_on_joints(model)
        self._shapes = pin.GeometryModel()
        self._index: dict[str, int] = {}
        self._levers_mm = _levers_mm(self._robot, frames, bodies)
        self.levers_mm = self._levers_mm.max(axis=0)
        for body in bodies:
            self._add(body.name, body.link, frames[body.link], _convex(body))
        for thing in things:
            self._add(thing.name, 0, _se3(thing.pose), _shape(thing.shape))
        self.look_at(())

    def look_at(self, pairs: tuple[Pair, ...]) -> None:
        """Choose the pairs that all answers are about."""
        self._shapes.removeAllCollisionPairs()
        for pair in pairs:
            a, b = self._index[pair.first], self._index[pair.second]
            self._shapes.addCollisionPair(pin.CollisionPair(a, b))
        self._found = self._shapes.createData()
        for request, pair in zip(self._found.collisionRequests, pairs, strict=True):
            request.security_margin = pair.least_mm / MM_PER_M
        self._results = list(self._found.distanceResults)
        self._chosen = np.ones(len(pairs), dtype=np.bool_)

    def choose(self, chosen: Bools) -> None:
        """Confine the answers to some of the pairs (p,)."""
        for pair in np.flatnonzero(chosen != self._chosen).tolist():
            if chosen[pair]:
                self._found.activateCollisionPair(pair)
            else:
                self._found.deactivateCollisionPair(pair)
        self._chosen = chosen

    def pair_levers_mm(self, pairs: tuple[Pair, ...]) -> Floats:
        """Return how far a joint moves two parts past each other at most, in mm a radian, (6, p).

        Joints that carry both parts, or neither, do not.
        """
        levers = np.zeros((N_JOINTS, len(pairs)))
        links = [part.parentJoint for part in self._shapes.geometryObjects]
        for column, pair in enumerate(pairs):
            first, second = self._index[pair.first], self._index[pair.second]
            inner = min(links[first], links[second])
            outer = first if links[first] >= links[second] else second
            levers[inner:, column] = self._levers_mm[outer, inner:]
        return levers

    def within_reach(self, thing: Obstacle) -> bool:
        """Return whether any part of the robot can come as near to a thing as it must not."""
        ball = coal.Sphere(float(self.levers_mm[0]) / MM_PER_M)
        places = (self._robot.jointPlacements[1], _se3(thing.pose))
        first, second = (coal.Transform3s(p.rotation, p.translation) for p in places)
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        shape = self._shapes.geometryObjects[self._index[thing.name]].geometry
        gap = coal.distance(ball, first, shape, second, request, result)
        return bool(gap * MM_PER_M <= thing.margin_mm)

    def meets(self, q_rad: Floats) -> bool:
        """Return whether any chosen pair comes closer than it must."""
        return bool(
            pin.computeCollisions(self._robot, self._state, self._shapes, self._found, q_rad, True)
        )

    def distances_mm(self, q_rad: Floats) -> Floats:
        """Return the distance of every chosen pair; negative by the depth where they overlap."""
        pin.computeDistances(self._robot, self._state, self._shapes, self._found, q_rad)
        results = compress(self._results, self._chosen)
        return np.array([result.min_distance for result in results]) * MM_PER_M

    def link_frames(self, qs_rad: Floats) -> tuple[Floats, Floats]:
        """Return the seven link frames in ``base`` at joint angles (n, 6), as the arm's does.

        Rotations (n, 7, 3, 3) and places (n, 7, 3) in mm, by Pinocchio's model.
        """
        rotations, places = joint_placements(self._robot, qs_rad)
        turns = np.array([frame.rotation for frame in self._frames])
        shifts = np.array([frame.translation for frame in self._frames])[:, :, None]
        places_mm = MM_PER_M * (places + (rotations @ shifts)[:, :, :, 0])
        return rotations @ turns, places_mm

    def normals_base(self, pairs: Ints) -> Floats:
        """Return the unit vectors (k, 3) along which some pairs were apart when last looked at."""
        normals = np.array([self._results[pair].normal for pair in pairs.tolist()])
        return normals.reshape(-1, 3)

    def _add(self, name: str, link: int, placement: Any, shape: Any) -> None:
        body = pin.GeometryObject(name, link, placement, shape)
        self._index[name] = self._shapes.addGeometryObject(body)


def _se3(pose: Pose) -> Any:
    return pin.SE3(pose.rotation, pose.translation / MM_PER_M)


@lru_cache(maxsize=64)  # a procedure looks at the same ones in three dozen worlds
def _convex(body: ConvexBody | Hull) -> Any:
    vertices = coal.StdVec_Vec3s()
    for point in body.vertices / MM_PER_M:
        vertices.append(point)
    return coal.Convex.convexHull(vertices, False, "")


def _shape(shape: Any) -> Any:
    if isinstance(shape, Hull):
        return _convex(shape)
    if isinstance(shape, Capsule):
        return coal.Capsule(shape.radius_mm / MM_PER_M, shape.length_mm / MM_PER_M)
    return coal.Box(*(np.array(shape.size_mm) / MM_PER_M))


@lru_cache(maxsize=4)
def _frames_on_joints(model: RobotModel) -> list[Any]:
    """Return the pose of each link frame on its joint, found at q = 0; read-only.

    Raises:
        InvalidInputError: elsewhere the link frames are not where the joints bring them.
    """
    robot, _ = pinocchio_model(model)
    state = robot.createData()
    frames: list[Any] = []
    rng = np.random.default_rng(0)
    qs = rng.uniform(model.lower_rad, model.upper_rad, (4, N_JOINTS))
    for q in (np.zeros(N_JOINTS), *qs):
        pin.forwardKinematics(robot, state, q)
        links = [_se3(pose) for pose in model.joint_poses(q)]
        frames = frames or [state.oMi[i].actInv(link) for i, link in enumerate(links)]
        for i, link in enumerate(links):
            off = (state.oMi[i] * frames[i]).homogeneous - link.homogeneous
            if np.abs(off).max() > SAME:
                raise InvalidInputError(f"link {i} of {model.name} is not where its joints say")
    return frames


def _levers_mm(robot: Any, frames: list[Any], bodies: tuple[ConvexBody, ...]) -> Floats:
    """Return how far each of b bodies can be from each joint axis at most, (b, 6)."""
    steps_mm = [MM_PER_M * np.linalg.norm(robot.jointPlacements[i].translation) for i in range(7)]
    levers = np.zeros((len(bodies), N_JOINTS))
    for row, body in enumerate(bodies):
        frame = frames[body.link]
        places = body.vertices @ frame.rotation.T + MM_PER_M * frame.translation
        own_mm = float(np.linalg.norm(places, axis=1).max())
        for joint in range(1, body.link + 1):
            levers[row, joint - 1] = own_mm + sum(steps_mm[joint + 1 : body.link + 1])
    return levers
