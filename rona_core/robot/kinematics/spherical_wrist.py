"""Forward kinematics of a six-joint arm whose last three axes meet in one point.

At q = 0 the arm stands upright. Axis 1 is vertical, axes 2 and 3 are horizontal and parallel,
axes 4 and 6 run along forearm and flange, axis 5 crosses them at the wrist centre.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_floats
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.ik_solutions import (
    BRANCHES,
    CHUNK,
    N_BRANCHES,
    N_JOINTS,
    ROUNDING,
    Branch,
    IkSolutions,
    sealed,
)

if TYPE_CHECKING:
    from rona_core.robot.kinematics.spherical_wrist import SphericalWristArm

__all__ = [
    "BRANCHES",
    "N_BRANCHES",
    "Branch",
    "IkSolutions",
    "inverse",
    "opposite",
    "solve",
    "wrapped",
]


def inverse(arm: "SphericalWristArm", Ts_base_flange: Poses) -> IkSolutions:
    """Return every joint vector that brings the flange to each pose.

    Args:
        arm: Lengths of the arm.
        Ts_base_flange: n poses of ``flange`` in ``base`` (mm).
    """
    return solve(arm, Ts_base_flange.rotations, Ts_base_flange.translations)


def solve(arm: "SphericalWristArm", rotations: Floats, translations: Floats) -> IkSolutions:
    """Return the same for rotations (n, 3, 3) and translations (n, 3) that are known to be good."""
    n = len(rotations)
    qs = np.zeros((N_BRANCHES, N_JOINTS, n))  # written and read a joint at a time
    shared = np.zeros((4, n))  # sine of the elbow, sine of the wrist above and below, distance
    reach = np.zeros(n)
    inside: Bools = np.zeros(n, dtype=np.bool_)
    for start in range(0, n, CHUNK):
        part = slice(start, min(start + CHUNK, n))
        axes = np.ascontiguousarray(rotations[part].reshape(-1, 9).T)  # row by row of the matrix
        wrists = translations[part].T - arm.flange_mm * axes[2::3]
        wrists[2] -= arm.shoulder_mm
        cos_elbow, reach[part] = _elbow(arm, wrists)
        inside[part] = np.abs(cos_elbow) <= 1.0 + ROUNDING
        _fill(arm, axes, wrists, cos_elbow, qs[:, :, part], shared[:, part])
    elbow, above, below, distance = shared
    pairs = np.stack((above, above, below, below))
    return IkSolutions(
        qs_rad=sealed(qs.transpose(2, 0, 1)),
        valid=_for_all(inside),
        sin_elbows=_for_all(elbow),
        sin_wrist=sealed(np.concatenate((pairs, pairs)).T),
        wrist_distance_mm=sealed(distance),
        reaches_mm=_for_all(reach),
    )


def wrapped(angles_rad: Floats) -> Floats:
    """Return angles within [-pi, pi], those already inside unchanged."""
    return angles_rad - 2.0 * np.pi * np.round(angles_rad / (2.0 * np.pi))


def opposite(angles_rad: Floats) -> Floats:
    """Return angles half a turn away, within [-pi, pi]."""
    return angles_rad - np.copysign(np.pi, angles_rad)


def _for_all(values: np.ndarray) -> np.ndarray:
    """Return values (n,) as those of all eight branches (n, 8), without a copy."""
    return np.broadcast_to(values[:, None], (len(values), N_BRANCHES))


def _elbow(arm: "SphericalWristArm", wrists: Floats) -> tuple[Floats, Floats]:
    """Return cos q3 (beyond [-1, 1] where out of reach) and the room of reach."""
    a, b = arm.upper_arm_mm, arm.forearm_mm
    squared = np.einsum("im,im->m", wrists, wrists)
    span = np.sqrt(squared)
    reach = np.minimum(a + b - span, span - abs(a - b))
    return (squared - a * a - b * b) / (2.0 * a * b), reach


def _fill(
    arm: "SphericalWristArm",
    axes: Floats,
    wrists: Floats,
    cos_elbow: Floats,
    qs: Floats,
    shared: Floats,
) -> None:
    """Fill angles (8, 6, m) and what the branches share (4, m) for a chunk of m poses.

    An arm that reaches over its back holds the forearm in the same direction, turned by half a
    turn about its length: (q1 + pi, -q2, -q3, q4 + pi, q5, q6). So only two of eight are solved.
    """
    a, b = arm.upper_arm_mm, arm.forearm_mm
    out = np.hypot(wrists[0], wrists[1])
    flat = out == 0.0  # on axis 1 any q1 will do
    q1 = np.arctan2(wrists[1], wrists[0])
    q1_back = opposite(q1)
    span = np.where(flat, 1.0, out)
    c1, s1 = np.where(flat, 1.0, wrists[0] / span), wrists[1] / span
    q3 = np.arccos(np.clip(cos_elbow, -1.0, 1.0))
    s3 = np.sin(q3)
    inner = np.arctan2(b * s3, a + b * np.cos(q3))
    lean_wrist = np.arctan2(out, wrists[2])
    shared[0], shared[3] = np.abs(s3), out
    xx, xy, xz, yx, yy, yz, zx, zy, zz = axes  # first letter: row; so column z is xz, yz, zz
    ahead_z, across_z = c1 * xz + s1 * yz, c1 * yz - s1 * xz
    ahead_x, across_x = c1 * xx + s1 * yx, c1 * yx - s1 * xx
    ahead_y, across_y = c1 * xy + s1 * yy, c1 * yy - s1 * xy
    for elbow, sign in ((0, 1.0), (1, -1.0)):
        q2 = wrapped(lean_wrist - sign * inner)
        lean = q2 + sign * q3
        c, s = np.cos(lean), np.sin(lean)
        along = c * ahead_z - s * zz  # the approach axis, seen from the forearm
        sine = np.hypot(along, across_z)
        q5 = np.arctan2(sine, s * ahead_z + c * zz)
        q4 = np.arctan2(across_z, along)  # arbitrary where the wrist is stretched: q6 follows it
        c4, s4 = np.cos(q4), np.sin(q4)
        q6 = np.arctan2(
            c4 * across_x - s4 * (c * ahead_x - s * zx),
            c4 * across_y - s4 * (c * ahead_y - s * zy),
        )
        shared[1 + elbow] = sine
        q4_over, q6_over = opposite(q4), opposite(q6)
        wrist = ((q4, q5, q6), (q4_over, -q5, q6_over))
        turned = ((q4_over, q5, q6), (q4, -q5, q6_over))
        for flip in (0, 1):
            qs[2 * elbow + flip] = (q1, q2, sign * q3, *wrist[flip])
            qs[4 + 2 * elbow + flip] = (q1_back, -q2, -sign * q3, *turned[flip])


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
        return Poses.unchecked(rotations, wrists_base + self.flange_mm * rotations[:, :, 2])

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
    rotations = np.zeros((len(angles_rad), 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(angles_rad)
    rotations[:, 1, 0] = np.sin(angles_rad)
    rotations[:, 0, 1] = -rotations[:, 1, 0]
    rotations[:, 2, 2] = 1.0
    return rotations


def about_y(angles_rad: Floats) -> Floats:
    """Return rotations (n, 3, 3) about y."""
    rotations = np.zeros((len(angles_rad), 3, 3))
    rotations[:, 0, 0] = rotations[:, 2, 2] = np.cos(angles_rad)
    rotations[:, 0, 2] = np.sin(angles_rad)
    rotations[:, 2, 0] = -rotations[:, 0, 2]
    rotations[:, 1, 1] = 1.0
    return rotations
