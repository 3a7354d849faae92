"""Inverse kinematics of the arm with three parallel axes in closed form: eight branches at once.

The crossing of axes 5 and 6 fixes joint 1 (two shoulders), the direction of axis 6 joint 5 (two
wrists), and the triangle of upper arm and forearm joints 2 to 4 (two elbows). Continuous along a
path, so that a branch keeps its label. See docs/algorithms/inverse_kinematics.md.
"""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.arrays import Bools, Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.ik import opposite, wrapped
from rona_core.robot.solutions import CHUNK, N_BRANCHES, N_JOINTS, ROUNDING, IkSolutions, sealed

if TYPE_CHECKING:
    from rona_core.robot.parallel_arm import ParallelArm

RIGHT_RAD = np.pi / 2.0
STRAIGHT = 1e-12  # sine of joint 5 below which axes 4 and 6 are parallel
TOUCHING_MM = 1e-9  # rounding that is forgiven where the arm reaches straight sideways


def inverse(arm: "ParallelArm", Ts_base_flange: Poses) -> IkSolutions:
    """Return every joint vector that brings the flange to each pose.

    Args:
        arm: Lengths of the arm.
        Ts_base_flange: n poses of ``flange`` in ``base`` (mm).
    """
    return solve(arm, Ts_base_flange.rotations, Ts_base_flange.translations)


def solve(arm: "ParallelArm", rotations: Floats, translations: Floats) -> IkSolutions:
    """Return the same for rotations (n, 3, 3) and translations (n, 3) that are known to be good."""
    n = len(rotations)
    qs = np.zeros((N_BRANCHES, N_JOINTS, n))  # written and read a joint at a time
    elbows, wrists = np.zeros((N_BRANCHES, n)), np.zeros((N_BRANCHES, n))
    reaches, distance = np.zeros((N_BRANCHES, n)), np.zeros(n)
    valid: Bools = np.zeros((N_BRANCHES, n), dtype=np.bool_)
    for start in range(0, n, CHUNK):
        part = slice(start, min(start + CHUNK, n))
        axes = np.ascontiguousarray(rotations[part].reshape(-1, 9).T)  # row by row of the matrix
        center = translations[part].T - arm.flange_mm * axes[2::3]  # where axes 5 and 6 cross
        center[2] -= arm.shoulder_mm
        away = np.hypot(center[0], center[1])
        lacking = away - abs(arm.side_mm)  # negative: too close to axis 1 for the lateral offset
        out = np.sqrt(np.maximum(0.0, lacking * (away + abs(arm.side_mm))))
        distance[part] = out
        towards = np.arctan2(center[1], center[0])
        turn = np.arctan2(arm.side_mm, out)
        for back in (0, 1):
            q1 = wrapped(towards - turn) if not back else wrapped(towards + turn - np.pi)
            near = -out if back else out
            sine, wrists_of = _wrists(arm, q1, axes, near, center[2])
            for flip, (lean, q5, q6) in enumerate(wrists_of):
                x, z = near - arm.wrist_mm * np.sin(lean), center[2] - arm.wrist_mm * np.cos(lean)
                cos_elbow, room, towards_wrist = _triangle(arm, x, z)
                room = np.where(lacking < -TOUCHING_MM, np.minimum(room, lacking), room)
                inside = (np.abs(cos_elbow) <= 1.0 + ROUNDING) & (lacking >= -TOUCHING_MM)
                cos_elbow = np.clip(cos_elbow, -1.0, 1.0)
                size = np.arccos(cos_elbow)
                bend = np.sin(size)
                inner = np.arctan2(
                    arm.forearm_mm * bend, arm.upper_arm_mm + arm.forearm_mm * cos_elbow
                )
                for below in (0, 1):
                    sign = 1.0 if below == back else -1.0  # behind, "above" bends the other way
                    branch = 4 * back + 2 * below + flip
                    q2 = wrapped(towards_wrist - sign * inner - RIGHT_RAD)
                    q3 = sign * size
                    q4 = wrapped(lean - np.pi - q2 - q3)
                    qs[branch, :, part] = (q1, q2, q3, q4, q5, q6)
                    elbows[branch, part], wrists[branch, part] = bend, sine
                    reaches[branch, part], valid[branch, part] = room, inside
    return IkSolutions(
        qs_rad=sealed(qs.transpose(2, 0, 1)),
        valid=_sealed_mask(valid.T),
        sin_elbows=sealed(elbows.T),
        sin_wrist=sealed(wrists.T),
        wrist_distance_mm=sealed(distance),
        reaches_mm=sealed(reaches.T),
    )


def _sealed_mask(mask: Bools) -> Bools:
    mask.setflags(write=False)
    return mask


def _wrists(
    arm: "ParallelArm", q1: Floats, axes: Floats, near: Floats, height: Floats
) -> tuple[Floats, tuple[tuple[Floats, Floats, Floats], ...]]:
    """Return the size of sin q5, and of both wrists the lean of axis 5, q5 and q6.

    Where axes 4 and 6 are parallel any lean gives the pose. Then axis 5 lies along the line from
    the shoulder, so that it brings axis 4 nearer where that is far and further where it is near:
    the elbow can bend if there is any lean with which it can.
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz = axes  # first letter: row; so column z is xz, yz, zz
    c1, s1 = np.cos(q1), np.sin(q1)
    ahead, across = c1 * xz + s1 * yz, c1 * yz - s1 * xz  # of axis 6, in the plane of the arm
    sine = np.hypot(ahead, zz)
    lean = np.arctan2(zz, -ahead)
    straight = sine < STRAIGHT
    some = bool(straight.any())
    if some:
        far = near**2 + height**2 > arm.upper_arm_mm**2 + arm.forearm_mm**2
        side = np.where(far, 1.0, -1.0)
        lean = np.where(straight, np.arctan2(side * near, side * height), lean)
    c, s = np.cos(lean), np.sin(lean)
    along_x = s * (c1 * xx + s1 * yx) + c * zx  # axis 5, seen from the flange
    along_y = s * (c1 * xy + s1 * yy) + c * zy
    q5, q6 = np.arctan2(sine, across), np.arctan2(-along_x, -along_y)
    lean_over, q6_over = opposite(lean), opposite(q6)
    if some:
        lean_over = np.where(straight, lean, lean_over)
        q6_over = np.where(straight, q6, q6_over)
    return sine, ((lean, q5, q6), (lean_over, -q5, q6_over))


def _triangle(arm: "ParallelArm", x: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
    """Return cos q3 (beyond [-1, 1] where out of reach), room of reach, direction to axis 4."""
    a, b = arm.upper_arm_mm, arm.forearm_mm
    squared = x * x + z * z
    span = np.sqrt(squared)
    reach = np.minimum(a + b - span, span - abs(a - b))
    return (squared - a * a - b * b) / (2.0 * a * b), reach, np.arctan2(x, z)
