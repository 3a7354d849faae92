"""Forward kinematics of a six-joint arm whose last three axes meet in one point.

At q = 0 the arm stands upright. Axis 1 is vertical, axes 2 and 3 are horizontal and parallel,
axes 4 and 6 run along forearm and flange, axis 5 crosses them at the wrist centre.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import Floats, as_floats
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Poses
from rona_core.robot.ik import inverse
from rona_core.robot.solutions import N_JOINTS, IkSolutions


class Arm(Protocol):
    """The kinematics of a six-joint arm, whatever its build."""

    def forward(self, qs_rad: ArrayLike) -> Poses:
        """Return ``Ts_base_flange`` for joint angles (n, 6) in radians."""
        ...

    def inverse(self, Ts_base_flange: Poses) -> IkSolutions:
        """Return every joint vector that brings the flange to each pose."""
        ...

    def link_poses(self, q_rad: ArrayLike) -> Poses:
        """Return base and the six link frames in ``base`` for one joint vector (6,)."""
        ...


def as_joints(qs_rad: ArrayLike, *, name: str = "qs_rad") -> Floats:
    """Return joint angles as finite float64 (n, 6), in radians.

    Raises:
        InvalidInputError: wrong shape, NaN or infinite values.
    """
    qs = as_floats(qs_rad, name=name)
    if qs.ndim != 2 or qs.shape[1] != N_JOINTS:
        raise InvalidInputError(f"{name} must have shape (n, 6), not {qs.shape}")
    return qs


@dataclass(frozen=True, slots=True)
class SphericalWristArm:
    """Lengths of the arm, without lateral offsets."""

    shoulder_mm: float  # base to axis 2, along the vertical
    upper_arm_mm: float  # axis 2 to axis 3
    forearm_mm: float  # axis 3 to the wrist centre
    flange_mm: float  # wrist centre to the flange face

    def __post_init__(self) -> None:
        for name in ("shoulder_mm", "upper_arm_mm", "forearm_mm", "flange_mm"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidInputError(f"{name} must be a positive length, not {value}")

    def forward(self, qs_rad: ArrayLike) -> Poses:
        """Return ``Ts_base_flange`` for joint angles (n, 6) in radians."""
        qs = as_joints(qs_rad)
        wrists_base, rotations = self._wrists(qs)
        rotations = rotations @ about_z(qs[:, 3]) @ about_y(qs[:, 4]) @ about_z(qs[:, 5])
        return Poses(rotations, wrists_base + self.flange_mm * rotations[:, :, 2])

    def inverse(self, Ts_base_flange: Poses) -> IkSolutions:
        """Return every joint vector that brings the flange to each pose."""
        return inverse(self, Ts_base_flange)

    def link_poses(self, q_rad: ArrayLike) -> Poses:
        """Return the seven link frames in ``base`` for one joint vector (6,) in radians.

        Base; links 1 and 2 with their origin at the shoulder, link 3 at the elbow, links 4 and 5
        at the wrist centre, link 6 at the flange face (the same pose as ``forward``).
        """
        q = as_joints(np.atleast_2d(as_floats(q_rad, name="q_rad")), name="q_rad")
        rotation, position = np.eye(3), np.zeros(3)
        rotations, positions = [rotation], [position]
        steps = (
            (about_z, self.shoulder_mm, 0.0),
            (about_y, 0.0, 0.0),
            (about_y, self.upper_arm_mm, 0.0),
            (about_z, self.forearm_mm, 0.0),
            (about_y, 0.0, 0.0),
            (about_z, 0.0, self.flange_mm),
        )
        for i, (turn, before_mm, after_mm) in enumerate(steps):
            position = position + before_mm * rotation[:, 2]
            rotation = rotation @ turn(q[:, i])[0]
            position = position + after_mm * rotation[:, 2]
            rotations.append(rotation)
            positions.append(position)
        return Poses(np.stack(rotations), np.stack(positions))

    def _wrists(self, qs: Floats) -> tuple[Floats, Floats]:
        """Return wrist centres (n, 3) and forearm rotations (n, 3, 3) in ``base``."""
        lean = qs[:, 1] + qs[:, 2]
        out_mm = self.upper_arm_mm * np.sin(qs[:, 1]) + self.forearm_mm * np.sin(lean)
        up_mm = self.upper_arm_mm * np.cos(qs[:, 1]) + self.forearm_mm * np.cos(lean)
        wrists_base = np.stack(
            (np.cos(qs[:, 0]) * out_mm, np.sin(qs[:, 0]) * out_mm, self.shoulder_mm + up_mm), axis=1
        )
        return wrists_base, about_z(qs[:, 0]) @ about_y(lean)


def about_z(angles_rad: Floats) -> Floats:
    """Return rotations (n, 3, 3) about z."""
    c, s = np.cos(angles_rad), np.sin(angles_rad)
    o, i = np.zeros_like(c), np.ones_like(c)
    return np.stack((c, -s, o, s, c, o, o, o, i), axis=-1).reshape(-1, 3, 3)


def about_y(angles_rad: Floats) -> Floats:
    """Return rotations (n, 3, 3) about y."""
    c, s = np.cos(angles_rad), np.sin(angles_rad)
    o, i = np.zeros_like(c), np.ones_like(c)
    return np.stack((c, o, s, o, i, o, -s, o, c), axis=-1).reshape(-1, 3, 3)
