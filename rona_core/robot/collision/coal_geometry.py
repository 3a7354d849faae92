"""Robot and obstacles as Pinocchio and Coal know them: the one module here that talks to Coal.

The joints are found from the link frames of the model, so that any arm will do: frame i turns about
an axis that is fixed in it. Lengths are metres inside, millimetres outside.
"""

# pyright: reportAttributeAccessIssue=false
# (the members of pinocchio and coal come from compiled modules without stubs)

from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_geometry import ConvexBody
from rona_core.robot.collision.obstacles import Capsule, Hull, Obstacle, capsule_between
from rona_core.robot.kinematics.pinocchio_model import MM_PER_M, PinocchioArm
from rona_core.robot.kinematics.robot_model import RobotModel

SAME_MM = 1e-6  # by which Pinocchio's own model of the arm may differ from the link frames
N_JOINTS = 6


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
            InvalidInputError: link frames that do not turn about fixed axes, or that disagree with
                Pinocchio's model of the arm.
        """
        self._robot, frames = _joints(model)
        self._state = self._robot.createData()
        _compare(model, self._robot, self._state, frames)
        self._shapes = pin.GeometryModel()
        self._index: dict[str, int] = {}
        self.levers_mm = _levers_mm(self._robot, frames, bodies)
        for body in bodies:
            shape, on_link = _body_shape(body)
            self._add(body.name, body.link, frames[body.link] * on_link, shape)
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

    def within_reach(self, thing: Obstacle) -> bool:
        """Return whether any part of the robot can come as near to a thing as it must not."""
        ball = coal.Sphere(float(self.levers_mm[0]) / MM_PER_M)
        places = (self._robot.jointPlacements[1], _se3(thing.pose))
        first, second = (coal.Transform3s(p.rotation, p.translation) for p in places)
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        gap = coal.distance(ball, first, _shape(thing.shape), second, request, result)
        return bool(gap * MM_PER_M <= thing.margin_mm)

    def meets(self, q_rad: Floats) -> bool:
        """Return whether any pair comes closer than it must."""
        return bool(
            pin.computeCollisions(self._robot, self._state, self._shapes, self._found, q_rad, True)
        )

    def distances_mm(self, q_rad: Floats) -> Floats:
        """Return the distance of every pair (p,); negative by the depth where they overlap."""
        pin.computeDistances(self._robot, self._state, self._shapes, self._found, q_rad)
        results = self._found.distanceResults
        return np.array([result.min_distance for result in results]) * MM_PER_M

    def _add(self, name: str, link: int, placement: Any, shape: Any) -> None:
        body = pin.GeometryObject(name, link, placement, shape)
        self._index[name] = self._shapes.addGeometryObject(body)


def _se3(pose: Pose) -> Any:
    return pin.SE3(pose.rotation, pose.translation / MM_PER_M)


def _convex(points: Floats) -> Any:
    vertices = coal.StdVec_Vec3s()
    for point in points / MM_PER_M:
        vertices.append(point)
    return coal.Convex.convexHull(vertices, False, "")


def _shape(shape: Any) -> Any:
    if isinstance(shape, Hull):
        return _convex(shape.vertices)
    if isinstance(shape, Capsule):
        return coal.Capsule(shape.radius_mm / MM_PER_M, shape.length_mm / MM_PER_M)
    return coal.Box(*(np.array(shape.size_mm) / MM_PER_M))


def _body_shape(body: ConvexBody) -> tuple[Any, Any]:
    """Return the shape of a body of the robot and where it sits on its link."""
    if not body.radius_mm:
        return _convex(body.vertices), pin.SE3.Identity()
    start, end = body.vertices
    made = capsule_between(body.name, start, end, body.radius_mm, 0.0)
    return _shape(made.shape), _se3(made.pose)


def _joints(model: RobotModel) -> tuple[Any, list[Any]]:
    """Return a Pinocchio model of the six joints, and each link frame on its joint.

    With the joint before a link at 0 and at a right angle, the link turns about one axis; its
    direction and a place on it follow from how the frame moves.
    """
    robot = pin.Model()
    robot.name = model.name
    still = model.joint_poses(np.zeros(N_JOINTS))
    frames = [pin.SE3.Identity()]
    parent_frame = pin.SE3.Identity()  # of link i - 1 on its joint
    for i in range(N_JOINTS):
        turned = model.joint_poses(np.where(np.arange(N_JOINTS) == i, np.pi / 2.0, 0.0))
        step = still[i].inv() @ still[i + 1]
        moved = step.inv() @ (turned[i].inv() @ turned[i + 1])
        rotation, shift = moved.rotation, moved.translation
        axis = 0.5 * np.array(
            (
                rotation[2, 1] - rotation[1, 2],
                rotation[0, 2] - rotation[2, 0],
                rotation[1, 0] - rotation[0, 1],
            )
        )
        if abs(np.linalg.norm(axis) - 1.0) > SAME_MM or abs(axis @ shift) > SAME_MM:
            raise InvalidInputError(f"link {i + 1} of {model.name} does not turn about one axis")
        # a place c on the axis: shift = c - R c, and c across the axis
        place = 0.5 * (shift + np.cross(axis, shift))
        offset = pin.SE3(np.eye(3), place / MM_PER_M)  # the joint, in the frame of its link
        joint = pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))
        placement = parent_frame * _se3(step) * offset
        robot.addJoint(i, joint, placement, f"joint{i + 1}")
        parent_frame = offset.inverse()
        frames.append(parent_frame)
    return robot, frames


def _levers_mm(robot: Any, frames: list[Any], bodies: tuple[ConvexBody, ...]) -> Floats:
    """Return how far any part of the robot can be from each joint axis at most, (6,)."""
    steps_mm = [MM_PER_M * np.linalg.norm(robot.jointPlacements[i].translation) for i in range(7)]
    levers = np.zeros(N_JOINTS)
    for body in bodies:
        places = body.vertices + MM_PER_M * frames[body.link].translation
        own_mm = float(np.linalg.norm(places, axis=1).max()) + body.radius_mm
        for joint in range(1, body.link + 1):
            lever_mm = own_mm + sum(steps_mm[joint + 1 : body.link + 1])
            levers[joint - 1] = max(levers[joint - 1], lever_mm)
    return levers


def _compare(model: RobotModel, robot: Any, state: Any, frames: list[Any]) -> None:
    """Raise InvalidInputError unless all link frames and the verifier's own arm agree."""
    rng = np.random.default_rng(0)
    qs = rng.uniform(model.lower_rad, model.upper_rad, (4, N_JOINTS))
    flanges = PinocchioArm(model).forward(qs)
    for q, flange in zip(qs, flanges, strict=True):
        pin.forwardKinematics(robot, state, q)
        drawn = model.joint_poses(q)
        for link in range(1, N_JOINTS + 1):
            here = state.oMi[link] * frames[link]
            gap = np.abs(MM_PER_M * here.translation - drawn.translations[link]).max()
            turn = np.abs(here.rotation - drawn.rotations[link]).max()
            if gap > SAME_MM or turn > SAME_MM:
                raise InvalidInputError(f"link {link} of {model.name} is not where its joints say")
        if np.abs(drawn.translations[N_JOINTS] - flange.translation).max() > SAME_MM:
            raise InvalidInputError(f"the link frames of {model.name} end beside its flange")
