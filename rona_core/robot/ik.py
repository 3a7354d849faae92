"""Inverse kinematics of the spherical-wrist arm in closed form: all eight branches at once.

The wrist centre fixes joints 1 to 3 (two shoulders times two elbows), the remaining rotation
fixes joints 4 to 6 (two wrists). See docs/algorithms/inverse_kinematics.md.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Poses
from rona_core.robot.arm import N_JOINTS, SphericalWristArm

N_BRANCHES = 8
CHUNK = 1024  # poses worked on together, so that intermediate arrays stay in the cache
ROUNDING = 1e-12  # how far a cosine may exceed 1 and still count as a stretched arm


@dataclass(frozen=True, slots=True)
class Branch:
    """One of the eight ways to reach a pose."""

    shoulder: Literal["front", "back"]  # wrist before or behind axis 1, seen by joint 1
    elbow: Literal["above", "below"]  # elbow above or below the line from shoulder to wrist
    wrist: Literal["plain", "flipped"]  # q5 >= 0 or q5 <= 0

    @property
    def label(self) -> str:
        """Name the branch for people."""
        return f"{self.shoulder}, elbow {self.elbow}, wrist {self.wrist}"


BRANCHES = tuple(
    Branch(shoulder, elbow, wrist)
    for shoulder in ("front", "back")
    for elbow in ("above", "below")
    for wrist in ("plain", "flipped")
)


@dataclass(frozen=True, slots=True, eq=False)
class IkSolutions:
    """All branches for n poses, and how far each is from where the arm loses a freedom.

    A pose out of reach has ``valid`` false; its angles then point the stretched (or folded) arm
    at it. Angles are principal values: each may be shifted by full turns where limits allow.
    """

    qs_rad: Floats  # (n, 8, 6) in the order of BRANCHES
    valid: Bools  # (n, 8) the pose can be reached; joint limits are not looked at
    sin_elbow: Floats  # (n,) |sin q3|, the same for all branches
    sin_wrist: Floats  # (n, 8) |sin q5|
    wrist_distance_mm: Floats  # (n,) wrist centre to axis 1
    reach_mm: Floats  # (n,) room left to the nearer end of the reach; negative if outside

    def __len__(self) -> int:
        return len(self.qs_rad)


def inverse(arm: SphericalWristArm, Ts_base_flange: Poses) -> IkSolutions:
    """Return every joint vector that brings the flange to each pose.

    Args:
        arm: Lengths of the arm.
        Ts_base_flange: n poses of ``flange`` in ``base`` (mm).
    """
    n = len(Ts_base_flange)
    qs = np.zeros((n, N_BRANCHES, N_JOINTS))
    sin_wrist = np.zeros((n, N_BRANCHES))
    cos_elbow, distance, reach = np.zeros(n), np.zeros(n), np.zeros(n)
    for start in range(0, n, CHUNK):
        part = slice(start, start + CHUNK)
        rotations = Ts_base_flange.rotations[part]
        wrists = Ts_base_flange.translations[part] - arm.flange_mm * rotations[:, :, 2]
        wrists[:, 2] -= arm.shoulder_mm
        cos_elbow[part], distance[part], reach[part] = _arm_triangle(arm, wrists)
        _solve(arm, rotations, wrists, cos_elbow[part], qs[part], sin_wrist[part])
    inside = np.abs(cos_elbow) <= 1.0 + ROUNDING
    return IkSolutions(
        qs_rad=readonly(qs),
        valid=readonly(np.repeat(inside[:, None], N_BRANCHES, axis=1)),
        sin_elbow=readonly(np.sqrt(np.maximum(0.0, 1.0 - cos_elbow**2))),
        sin_wrist=readonly(sin_wrist),
        wrist_distance_mm=readonly(distance),
        reach_mm=readonly(reach),
    )


def _arm_triangle(arm: SphericalWristArm, wrists: Floats) -> tuple[Floats, Floats, Floats]:
    """Return cos q3 (beyond [-1, 1] where out of reach), distance to axis 1, and room of reach."""
    a, b = arm.upper_arm_mm, arm.forearm_mm
    squared = np.einsum("ij,ij->i", wrists, wrists)
    span = np.sqrt(squared)
    reach = np.minimum(a + b - span, span - abs(a - b))
    return (squared - a * a - b * b) / (2.0 * a * b), np.hypot(wrists[:, 0], wrists[:, 1]), reach


def _solve(
    arm: SphericalWristArm,
    rotations: Floats,
    wrists: Floats,
    cos_elbow: Floats,
    qs: Floats,
    sin_wrist: Floats,
) -> None:
    """Fill ``qs`` (m, 8, 6) and ``sin_wrist`` (m, 8) for a chunk of m poses."""
    q3_size = np.arccos(np.clip(cos_elbow, -1.0, 1.0))
    q1_front = np.arctan2(wrists[:, 1], wrists[:, 0])
    out_front = np.hypot(wrists[:, 0], wrists[:, 1])
    x, y, z = rotations[:, :, 0], rotations[:, :, 1], rotations[:, :, 2]
    for arm_branch, (shoulder, elbow) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        q1 = q1_front if shoulder > 0 else _wrapped(q1_front + np.pi)
        q3 = shoulder * elbow * q3_size  # behind the base, "above" bends the other way
        inner = np.arctan2(
            arm.forearm_mm * np.sin(q3), arm.upper_arm_mm + arm.forearm_mm * np.cos(q3)
        )
        q2 = _wrapped(np.arctan2(shoulder * out_front, wrists[:, 2]) - inner)
        c1, s1, lean = np.cos(q1), np.sin(q1), q2 + q3
        c, s = np.cos(lean), np.sin(lean)
        x3 = np.stack((c1 * c, s1 * c, -s), axis=1)  # axes of the forearm in base
        y3 = np.stack((-s1, c1, np.zeros_like(c1)), axis=1)
        z3 = np.stack((c1 * s, s1 * s, c), axis=1)
        along, across = np.einsum("ij,ij->i", x3, z), np.einsum("ij,ij->i", y3, z)
        sine = np.hypot(along, across)
        q5 = np.arctan2(sine, np.einsum("ij,ij->i", z3, z))
        q4 = np.arctan2(across, along)  # arbitrary where the wrist is stretched: q6 follows it
        y4 = np.cos(q4)[:, None] * y3 - np.sin(q4)[:, None] * x3
        q6 = np.arctan2(np.einsum("ij,ij->i", y4, x), np.einsum("ij,ij->i", y4, y))
        for flip in (0, 1):
            branch = 2 * arm_branch + flip
            wrist = (q4, q5, q6) if not flip else (_opposite(q4), -q5, _opposite(q6))
            for joint, angle in enumerate((q1, q2, q3, *wrist)):
                qs[:, branch, joint] = angle
            sin_wrist[:, branch] = sine


def _wrapped(angles_rad: Floats) -> Floats:
    """Return angles within [-pi, pi], those already inside unchanged."""
    return angles_rad - 2.0 * np.pi * np.round(angles_rad / (2.0 * np.pi))


def _opposite(angles_rad: Floats) -> Floats:
    """Return angles half a turn away, within [-pi, pi]."""
    return angles_rad - np.copysign(np.pi, angles_rad)
