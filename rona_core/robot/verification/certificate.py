"""The certificate of a motion: its checks, and the digests of the motion and the robot.

The digest of a robot: whatever of it a certificate rests on. Two robots have the same digest if
their models have equal fields, the verifier's model of the arm is the same, and so are the bodies
and the pairs of bodies that are looked at for collisions. The name of a robot and the path of its
description do not count: what that file says does.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_geometry import collision_bodies
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import DIGEST_DECIMALS, Obstacles
from rona_core.robot.kinematics.pinocchio_model import MM_PER_M, pinocchio_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import TimedMotion, motion_digest
from rona_core.robot.verification.tolerances import CuttingTolerances, Tolerances, tolerances_digest

NOT_COUNTED = ("name", "urdf")  # fields of ``RobotModel``

Part = tuple[str, object]


@lru_cache(maxsize=8)  # asked for whenever a plan is shown
def robot_digest(model: RobotModel) -> str:
    """Return the SHA-256 of a robot with its tool, as hexadecimal digits.

    Numbers that are stated count to the last bit. Poses and bodies, which are products of sines,
    count to the nanometre: their last bits depend on the processor that computed them.

    Raises:
        InvalidInputError: a robot without collision bodies, or a field of a type without a rule.
    """
    hasher = hashlib.sha256()
    for place, value in _parts(model):
        hasher.update(f"{place}\n".encode())
        hasher.update(_bytes(place, value))
    return hasher.hexdigest()


def _parts(model: RobotModel) -> Iterator[Part]:
    """Yield whatever counts, with the name of its place."""
    for one in fields(model):
        if one.name not in NOT_COUNTED:
            yield from _fields(one.name, getattr(model, one.name))
    yield from _verifiers_model(model)
    for body in collision_bodies(model):
        yield f"body {body.name} on link {body.link}", _rounded(body.vertices)
    yield "pairs", tuple((pair.first, pair.second) for pair in CollisionWorld(model).pairs)


def _fields(place: str, value: object) -> Iterator[Part]:
    """Yield the fields of a dataclass and of those within it, or the value as it is."""
    if isinstance(value, Pose):
        yield place, _rounded(np.column_stack((value.rotation, value.translation)))
    elif is_dataclass(value) and not isinstance(value, type):
        yield place, type(value).__name__
        for one in fields(value):
            yield from _fields(f"{place}.{one.name}", getattr(value, one.name))
    else:
        yield place, value


def _verifiers_model(model: RobotModel) -> Iterator[Part]:
    """Yield kind and placement of each joint, and of the flange, in mm on the one before."""
    built, flange = pinocchio_model(model)
    placements = [*list(built.jointPlacements)[1:], built.frames[flange].placement]
    kinds = (*(joint.shortname() for joint in list(built.joints)[1:]), "flange")
    for number, (kind, placement) in enumerate(zip(kinds, placements, strict=True), start=1):
        at = np.column_stack((placement.rotation, MM_PER_M * placement.translation))
        yield f"joint {number} of the verifier: {kind}", _rounded(at)


def _rounded(numbers: ArrayLike) -> Floats:
    return np.round(np.asarray(numbers, dtype=np.float64), DIGEST_DECIMALS) + 0.0  # no -0


def _bytes(place: str, value: object) -> bytes:
    """Return a value as bytes, different ones for different values.

    Raises:
        InvalidInputError: no rule for its type: a part of the robot would not count.
    """
    if isinstance(value, np.ndarray):
        exact = np.ascontiguousarray(value, dtype="<f8")
        return f"{exact.shape}\n".encode() + exact.tobytes()
    if isinstance(value, tuple):
        parts = [_bytes(place, part) for part in value]
        return b"(" + b"".join(f"{len(part)}:".encode() + part for part in parts) + b")"
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value).encode()  # of a float the shortest text that gives it back
    raise InvalidInputError(
        f"{place} of a robot must be numbers, texts, arrays or dataclasses of them to count in "
        f"its digest, not {type(value).__name__}"
    )


OF_EVERY_MOTION = Tolerances()


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that the verifier looked at: its worst value, where, and what is allowed."""

    name: str
    value: float
    limit: float
    unit: str
    index: int  # sample of the motion
    holds: bool
    sentence: str


@dataclass(frozen=True, slots=True)
class Certificate:
    """The verifier's word on one motion of one robot; worth nothing for any other."""

    model: str  # name of the robot, for people
    certified: bool
    checks: tuple[Check, ...]
    digest: str  # of robot, motion, what stood around and what was insisted on
    robot: str  # digest of the robot
    tolerances: str  # digest of what the verifier insisted on
    obstacles: str = ""  # digest of what stood around; "" where that was not looked at
    min_clearance_mm: float | None = None  # of parts that must not touch; None: not looked at

    def belongs_to(self, motion: TimedMotion) -> bool:
        """Return whether this is the motion that was looked at, and everything held.

        That is not enough to drive it: see ``certifies``.
        """
        digest = motion_digest(
            self.robot, motion.times_s, motion.qs_rad, self.obstacles, self.tolerances
        )
        return self.certified and self.digest == digest

    def certifies(
        self,
        motion: TimedMotion,
        model: RobotModel,
        obstacles: Obstacles,
        insisted: Tolerances | CuttingTolerances = OF_EVERY_MOTION,
    ) -> bool:
        """Return whether this robot may drive this motion among these things; see ``refusal``."""
        return self.refusal(motion, model, obstacles, insisted) is None

    def refusal(
        self,
        motion: TimedMotion,
        model: RobotModel,
        obstacles: Obstacles,
        insisted: Tolerances | CuttingTolerances = OF_EVERY_MOTION,
    ) -> str | None:
        """Return why a robot may not drive a motion, and what to do; None where it may.

        Args:
            motion: The motion.
            model: The robot that is to drive it, with the tool that it holds.
            obstacles: What stands around it.
            insisted: What the verifier insists on in such a motion.
        """
        if failures := self.failures():
            return "; ".join(check.sentence for check in failures)
        superseded = self.superseded(model, insisted)
        if superseded is not None:
            return superseded
        if self.obstacles != obstacles.digest():
            return "the plan was verified among other obstacles: plan again"
        if not self.belongs_to(motion):
            return "the plan was verified for another motion: plan again"
        return None

    def superseded(
        self, model: RobotModel, insisted: Tolerances | CuttingTolerances = OF_EVERY_MOTION
    ) -> str | None:
        """Return what to do where a motion was verified for another robot or other tolerances."""
        if self.robot != robot_digest(model):
            return (
                f"the plan was verified for another robot than this {model.name} (its lengths, "
                "limits, tool, bodies or pairs of bodies differ): plan again"
            )
        if self.tolerances != tolerances_digest(insisted):
            return (
                "the plan was verified with other tolerances than this version insists on in such "
                "a motion: plan again"
            )
        return None

    def failures(self) -> tuple[Check, ...]:
        """Return what did not hold."""
        return tuple(check for check in self.checks if not check.holds)


def is_certified(motion: TimedMotion | None, certificate: Certificate | None) -> bool:
    """Return whether there is a motion, and a certificate of it in which everything held."""
    return motion is not None and certificate is not None and certificate.belongs_to(motion)
