"""Inverse kinematics of the spherical-wrist arm in closed form: all eight branches at once.

The wrist centre fixes joints 1 to 3 (two shoulders times two elbows), the remaining rotation
fixes joints 4 to 6 (two wrists). See docs/algorithms/inverse_kinematics.md.
"""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.arrays import Bools, Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.solutions import (
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
    from rona_core.robot.arm import SphericalWristArm

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
