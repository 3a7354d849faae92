"""Capsules of robot and tool: cheap bounds for the occlusion test.

They lie within the solids that are drawn (``robot.meshes``), so that nothing is hidden by air.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.robot.collision.solids import SPREAD, radii_mm
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.kinematics.wrists import ParallelArm, SphericalWristArm

Part = tuple[int, ArrayLike, ArrayLike, float]  # link, start, end, radius in mm


@dataclass(frozen=True, slots=True, eq=False)
class Capsules:
    """Segments (n, k, 3) to (n, k, 3) with a radius (k,) about each, at n times, in one frame."""

    starts: Floats
    ends: Floats
    radii_mm: Floats


@dataclass(frozen=True, slots=True, eq=False)
class LinkCapsules:
    """Capsules of a robot, each in the frame of the link that carries it."""

    links: Ints  # (k,) index into ``RobotModel.joint_poses``
    starts: Floats  # (k, 3)
    ends: Floats  # (k, 3)
    radii_mm: Floats  # (k,)

    def at(self, model: RobotModel, qs_rad: Floats) -> Capsules:
        """Return the capsules in ``base`` at joint angles (n, 6)."""
        rotations, positions = (part[:, self.links] for part in model.arm.link_frames(qs_rad))
        starts = np.einsum("nkij,kj->nki", rotations, self.starts) + positions
        ends = np.einsum("nkij,kj->nki", rotations, self.ends) + positions
        return Capsules(starts, ends, self.radii_mm)


def link_capsules(model: RobotModel) -> LinkCapsules:
    """Return the capsules of a robot and its tool, without the marker plate.

    Raises:
        InvalidInputError: there is no collision geometry for an arm of this build.
    """
    links, starts, ends, radii = zip(*_arm_parts(model), *_tool_parts(model), strict=True)
    return LinkCapsules(
        readonly(np.array(links, dtype=np.int64)),
        readonly(np.array([np.asarray(p, dtype=np.float64) for p in starts])),
        readonly(np.array([np.asarray(p, dtype=np.float64) for p in ends])),
        readonly(np.array(radii)),
    )


def _arm_parts(model: RobotModel) -> list[Part]:
    arm = model.arm
    if isinstance(arm, SphericalWristArm):
        return _spherical_parts(arm)
    if isinstance(arm, ParallelArm):
        return _parallel_parts(arm)
    raise InvalidInputError(f"there are no capsules for the build of {model.name!r}")


def _spherical_parts(arm: SphericalWristArm) -> list[Part]:
    return [
        (0, (0, 0, 110), (0, 0, arm.shoulder_mm), 105.0),
        (1, (0, -18, 0), (0, -8, 0), 100.0),
        (2, (0, 142, 0), (0, 142, arm.upper_arm_mm), 45.0),
        (3, (0, 0, -90), (0, 0, 80), 70.0),
        (4, (0, 0, 225.0 - arm.forearm_mm), (0, 0, -112), 54.0),
        (5, (0, 0, 0), (0, 0, 20), 33.0),
        (6, (0, 0, 0), (0, 0, 2), 27.0),
    ]


def _parallel_parts(arm: ParallelArm) -> list[Part]:
    joint, elbow, wrist = radii_mm(arm)
    half = SPREAD * arm.shoulder_side_mm
    return [
        (1, (0, 0, -0.1 * joint), (0, 0, 0), 0.85 * joint),
        (2, (0, 0, 0), (0, 0, 1), min(half - 14.0, 0.9 * joint)),
        (2, (0, 0, 0), (0, 0, arm.upper_arm_mm), 0.68 * joint),
        (3, (0, 0, 0), (0, 0, arm.forearm_mm), 0.56 * elbow),
        (4, (0, 0, 0), (0, 0, arm.wrist_mm - 1.5 * wrist), 0.85 * wrist),
        (5, (0, 0, 0), (0, arm.flange_mm - 1.5 * wrist, 0), 0.85 * wrist),
    ]


def _tool_parts(model: RobotModel) -> list[Part]:
    tip = model.T_flange_tip
    return [
        (6, (0, 0, 40), (0, 0, 58), 16.0),
        (6, tip @ np.array((0.0, 0.0, -113.0)), tip @ np.array((0.0, 0.0, -76.0)), 17.0),
        (6, tip @ np.array((0.0, 0.0, -60.0)), tip @ np.array((0.0, 0.0, -14.0)), 5.0),
    ]
