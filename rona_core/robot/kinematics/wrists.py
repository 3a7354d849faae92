"""Closed-form kinematics of six-joint arms: spherical wrist, and wrist with offsets.

Kinematics of a six-joint arm whose last three axes meet in one point. At q = 0 the arm stands
upright. Axis 1 is vertical, axes 2 and 3 are horizontal and parallel, axes 4 and 6 run along
forearm and flange, axis 5 crosses them at the wrist centre (Pieper 1968: so the position of the
wrist centre gives q1 to q3, the orientation q4 to q6).

Kinematics of a six-joint arm whose axes 2, 3 and 4 are parallel, its wrist offset (UR5, UR10). At q
= 0 the arm lies along +x, the flange looks along +y. Axis 1 is vertical; axes 2, 3 and 4 run along
y, axis 5 crosses axis 4, axis 6 crosses axis 5. These are the conventions of the maker's
description; see docs/algorithms/robot/universal_robots.md.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.arm import (
    CHUNK,
    N_BRANCHES,
    N_JOINTS,
    ROUNDING,
    IkSolutions,
    about_y,
    about_z,
    as_joints,
    elbow_cosine,
    link_frames,
    opposite,
    up_after_turns,
    wrapped,
)


@dataclass(frozen=True, slots=True)
class SphericalWristArm:
    """Lengths of the arm, without lateral offsets."""

    shoulder_mm: float  # base to axis 2, along the vertical
    upper_arm_mm: float  # axis 2 to axis 3
    forearm_mm: float  # axis 3 to the wrist centre
    flange_mm: float  # wrist centre to the flange face

    def __post_init__(self) -> None:
        for length in fields(self):
            value = getattr(self, length.name)
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidInputError(f"{length.name} must be a positive length, not {value}")

    def forward(self, qs_rad: ArrayLike) -> Poses:
        """Return ``Ts_base_flange`` for joint angles (n, 6) in radians."""
        qs = as_joints(qs_rad)
        wrists_base, rotations = self._wrists(qs)
        rotations = rotations @ about_z(qs[:, 3]) @ about_y(qs[:, 4]) @ about_z(qs[:, 5])
        return Poses.unchecked(rotations, wrists_base + self.flange_mm * rotations[:, :, 2])

    def up_flange(self, q_rad: Floats) -> Floats:
        """Return z of ``base`` (3,) in ``flange`` for one posture (6,)."""
        _, q2, q3, *wrist = q_rad.tolist()
        return up_after_turns((q2 + q3, *wrist))

    def inverse(self, Ts_base_flange: Poses) -> IkSolutions:
        """Return every joint vector that brings the flange to each pose."""
        rotations, translations = Ts_base_flange.rotations, Ts_base_flange.translations
        n = len(rotations)
        qs = np.zeros((N_BRANCHES, N_JOINTS, n))  # written and read a joint at a time
        shared = np.zeros((4, n))  # sine of the elbow, sine of the wrist above and below, distance
        reach = np.zeros(n)
        inside: Bools = np.zeros(n, dtype=np.bool_)
        for start in range(0, n, CHUNK):
            part = slice(start, min(start + CHUNK, n))
            axes = np.ascontiguousarray(
                rotations[part].reshape(-1, 9).T
            )  # row by row of the matrix
            wrists = translations[part].T - self.flange_mm * axes[2::3]
            wrists[2] -= self.shoulder_mm
            cos_elbow, reach[part] = elbow_cosine(
                np.einsum("im,im->m", wrists, wrists), self.upper_arm_mm, self.forearm_mm
            )
            inside[part] = np.abs(cos_elbow) <= 1.0 + ROUNDING
            _fill(self, axes, wrists, cos_elbow, qs[:, :, part], shared[:, part])
        elbow, above, below, distance = shared
        pairs = np.stack((above, above, below, below))
        return IkSolutions(
            qs_rad=qs.transpose(2, 0, 1),
            valid=_for_all(inside),
            sin_elbows=_for_all(elbow),
            sin_wrist=np.concatenate((pairs, pairs)).T,
            wrist_distance_mm=distance,
            reaches_mm=_for_all(reach),
        )

    def link_frames(self, qs_rad: Floats) -> tuple[Floats, Floats]:
        """Return the seven link frames in ``base``: (n, 7, 3, 3) and (n, 7, 3), for angles (n, 6).

        Base; links 1 and 2 with their origin at the shoulder, link 3 at the elbow, links 4 and 5
        at the wrist centre, link 6 at the flange face (the same pose as ``forward``).
        """
        q = as_joints(qs_rad).T
        rotations, positions = link_frames(
            (
                (about_z, q[0], (0.0, 0.0, self.shoulder_mm)),
                (about_y, q[1], (0.0, 0.0, 0.0)),
                (about_y, q[2], (0.0, 0.0, self.upper_arm_mm)),
                (about_z, q[3], (0.0, 0.0, self.forearm_mm)),
                (about_y, q[4], (0.0, 0.0, 0.0)),
                (about_z, q[5], (0.0, 0.0, 0.0)),
            )
        )
        positions[:, 6] += self.flange_mm * rotations[:, 6, :, 2]
        return rotations, positions

    def _wrists(self, qs: Floats) -> tuple[Floats, Floats]:
        """Return wrist centres (n, 3) and forearm rotations (n, 3, 3) in ``base``."""
        lean = qs[:, 1] + qs[:, 2]
        out_mm = self.upper_arm_mm * np.sin(qs[:, 1]) + self.forearm_mm * np.sin(lean)
        up_mm = self.upper_arm_mm * np.cos(qs[:, 1]) + self.forearm_mm * np.cos(lean)
        wrists_base = np.stack(
            (np.cos(qs[:, 0]) * out_mm, np.sin(qs[:, 0]) * out_mm, self.shoulder_mm + up_mm), axis=1
        )
        return wrists_base, about_z(qs[:, 0]) @ about_y(lean)


def _for_all(values: np.ndarray) -> np.ndarray:
    """Return values (n,) as those of all eight branches (n, 8), without a copy."""
    return np.broadcast_to(values[:, None], (len(values), N_BRANCHES))


def _fill(
    arm: SphericalWristArm,
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


RIGHT_RAD = np.pi / 2.0
STRAIGHT = 1e-12  # sine of joint 5 below which axes 4 and 6 are parallel
TOUCHING_MM = 1e-9  # rounding that is forgiven where the arm reaches straight sideways
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

    def up_flange(self, q_rad: Floats) -> Floats:
        """Return z of ``base`` (3,) in ``flange`` for one posture (6,)."""
        _, q2, q3, q4, q5, q6 = q_rad.tolist()
        return up_after_turns((q2 + RIGHT_RAD + q3 + q4 + RIGHT_RAD, q5, q6)) @ FLANGE

    def inverse(self, Ts_base_flange: Poses) -> IkSolutions:
        """Return every joint vector that brings the flange to each pose."""
        return _solve(self, Ts_base_flange.rotations, Ts_base_flange.translations)

    def link_frames(self, qs_rad: Floats) -> tuple[Floats, Floats]:
        """Return the seven link frames in ``base``: (n, 7, 3, 3) and (n, 7, 3), for angles (n, 6).

        Base; link 1 at the shoulder on axis 1; link 2 beside it, z along the upper arm; link 3 at
        the elbow, z along the forearm; link 4 where axes 4 and 5 cross, link 5 where axes 5 and 6
        do; link 6 at the flange face, z out of it (the same pose as ``forward``).
        """
        q = as_joints(qs_rad).T
        rotations, positions = link_frames(
            (
                (about_z, q[0], (0.0, 0.0, self.shoulder_mm)),
                (about_y, q[1] + RIGHT_RAD, (0.0, self.shoulder_side_mm, 0.0)),
                (about_y, q[2], (0.0, self.elbow_side_mm, self.upper_arm_mm)),
                (about_y, q[3] + RIGHT_RAD, (0.0, self.wrist_side_mm, self.forearm_mm)),
                (about_z, q[4], (0.0, 0.0, 0.0)),
                (about_y, q[5], (0.0, 0.0, self.wrist_mm)),
            )
        )
        positions[:, 5] = positions[:, 6]  # link 5 ends where axes 5 and 6 cross
        positions[:, 6] += self.flange_mm * rotations[:, 6, :, 1]
        rotations[:, 6] = rotations[:, 6] @ FLANGE
        return rotations, positions


def _solve(arm: ParallelArm, rotations: Floats, translations: Floats) -> IkSolutions:
    """Return all branches for flange poses: rotations (n, 3, 3) and translations (n, 3)."""
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
                cos_elbow, room = elbow_cosine(x * x + z * z, arm.upper_arm_mm, arm.forearm_mm)
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
                    q2 = wrapped(np.arctan2(x, z) - sign * inner - RIGHT_RAD)
                    q3 = sign * size
                    q4 = wrapped(lean - np.pi - q2 - q3)
                    qs[branch, :, part] = (q1, q2, q3, q4, q5, q6)
                    elbows[branch, part], wrists[branch, part] = bend, sine
                    reaches[branch, part], valid[branch, part] = room, inside
    return IkSolutions(
        qs_rad=qs.transpose(2, 0, 1),
        valid=valid.T,
        sin_elbows=elbows.T,
        sin_wrist=wrists.T,
        wrist_distance_mm=distance,
        reaches_mm=reaches.T,
    )


def _wrists(
    arm: ParallelArm, q1: Floats, axes: Floats, near: Floats, height: Floats
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
