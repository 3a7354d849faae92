"""The digest of a robot: whatever of it a certificate rests on.

Two robots have the same digest if their models have equal fields, the verifier's model of the arm
is the same, and so are the bodies and the pairs of bodies that are looked at for collisions. The
name of a robot and the path of its description do not count: what that file says does.
"""

# pyright: reportAttributeAccessIssue=false
# (the members of pinocchio come from a compiled module without stubs)

import hashlib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_geometry import collision_bodies
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import DIGEST_DECIMALS
from rona_core.robot.kinematics.pinocchio_model import MM_PER_M, pinocchio_model
from rona_core.robot.kinematics.robot_model import RobotModel

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
    for field in fields(model):
        if field.name not in NOT_COUNTED:
            yield from _fields(field.name, getattr(model, field.name))
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
        for field in fields(value):
            yield from _fields(f"{place}.{field.name}", getattr(value, field.name))
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
