"""A six-joint arm whose axes 2, 3 and 4 are parallel and whose wrist has an offset (UR5, UR10).

At q = 0 the arm lies along +x, the flange looks along +y. Axis 1 is vertical; axes 2, 3 and 4 run
along y, axis 5 crosses axis 4, axis 6 crosses axis 5. These are the conventions of the maker's
description; see docs/algorithms/ur_arms.md.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import as_floats
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Poses
from rona_core.robot.arm import about_y, about_z, as_joints
from rona_core.robot.parallel_ik import inverse
from rona_core.robot.solutions import IkSolutions

RIGHT_RAD = np.pi / 2.0
FLANGE = np.array(((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)))  # z along axis 6


@dataclass(frozen=True, slots=True)
class ParallelArm:
    """Lengths of the arm; lateral ones along y of the turning column."""

    shoulder_mm: float  # base to axis 2, along the vertical
    shoulder_side_mm: float  # column to upper arm, sideways
    upper_arm_mm: float  # axis 2 to axis 3
    elbow_side_mm: float  # upper arm to forearm, sideways (back towards the column: negative)
    forearm_mm: float  # axis 3 to axis 4
    wrist_side_mm: float  # forearm to axis 5, sideways
    wrist_mm: float  # axis 4 to axis 6, along axis 5
    flange_mm: float  # axis 5 to the flange face, along axis 6

    def __post_init__(self) -> None:
        for field in fields(self):
            value = float(getattr(self, field.name))
            if not np.isfinite(value):
                raise InvalidInputError(f"{field.name} must be a length, not {value}")
            if not field.name.endswith("side_mm") and value <= 0.0:
                raise InvalidInputError(f"{field.name} must be a positive length, not {value}")

    @property
    def side_mm(self) -> float:
        """Distance of axis 5 from the plane of axes 1 and 2, sideways."""
        return self.shoulder_side_mm + self.elbow_side_mm + self.wrist_side_mm

    def forward(self, qs_rad: ArrayLike) -> Poses:
        """Return ``Ts_base_flange`` for joint angles (n, 6) in radians."""
        qs = as_joints(qs_rad)
        upper = qs[:, 1] + RIGHT_RAD  # angles from the vertical, in the plane of the arm
        fore = upper + qs[:, 2]
        wrist = fore + qs[:, 3] + RIGHT_RAD
        out = (
            self.upper_arm_mm * np.sin(upper)
            + self.forearm_mm * np.sin(fore)
            + self.wrist_mm * np.sin(wrist)
        )
        up = (
            self.upper_arm_mm * np.cos(upper)
            + self.forearm_mm * np.cos(fore)
            + self.wrist_mm * np.cos(wrist)
        )
        c1, s1 = np.cos(qs[:, 0]), np.sin(qs[:, 0])
        x = c1 * out - s1 * self.side_mm
        y = s1 * out + c1 * self.side_mm
        centers = np.stack((x, y, self.shoulder_mm + up), axis=1)
        rotations = about_z(qs[:, 0]) @ about_y(wrist) @ about_z(qs[:, 4]) @ about_y(qs[:, 5])
        return Poses(rotations @ FLANGE, centers + self.flange_mm * rotations[:, :, 1])

    def inverse(self, Ts_base_flange: Poses) -> IkSolutions:
        """Return every joint vector that brings the flange to each pose."""
        return inverse(self, Ts_base_flange)

    def link_poses(self, q_rad: ArrayLike) -> Poses:
        """Return the seven link frames in ``base`` for one joint vector (6,) in radians.

        Base; link 1 at the shoulder on axis 1; link 2 beside it, z along the upper arm; link 3 at
        the elbow, z along the forearm; link 4 where axes 4 and 5 cross, link 5 where axes 5 and 6
        do; link 6 at the flange face, z out of it (the same pose as ``forward``).
        """
        q = as_joints(np.atleast_2d(as_floats(q_rad, name="q_rad")), name="q_rad")[0]
        rotation, position = np.eye(3), np.zeros(3)
        rotations, positions = [rotation], [position]
        steps = (
            (about_z, 0.0, (0.0, 0.0, self.shoulder_mm)),
            (about_y, RIGHT_RAD, (0.0, self.shoulder_side_mm, 0.0)),
            (about_y, 0.0, (0.0, self.elbow_side_mm, self.upper_arm_mm)),
            (about_y, RIGHT_RAD, (0.0, self.wrist_side_mm, self.forearm_mm)),
            (about_z, 0.0, (0.0, 0.0, 0.0)),
            (about_y, 0.0, (0.0, 0.0, self.wrist_mm)),
        )
        for joint, (turn, zero_rad, offset) in enumerate(steps):
            position = position + rotation @ np.array(offset)
            rotation = rotation @ turn(np.array([q[joint] + zero_rad]))[0]
            positions.append(position)
            rotations.append(rotation)
        positions[5] = positions[6]  # link 5 ends where axes 5 and 6 cross
        positions[6] = positions[6] + self.flange_mm * rotation[:, 1]
        rotations[6] = rotation @ FLANGE
        return Poses(np.stack(rotations), np.stack(positions))
