"""Kinematics of a six-joint arm whose last three axes meet in one point.

At q = 0 the arm stands upright. Axis 1 is vertical, axes 2 and 3 are horizontal and parallel,
axes 4 and 6 run along forearm and flange, axis 5 crosses them at the wrist centre (Pieper 1968: so
the position of the wrist centre gives q1 to q3, the orientation q4 to q6).
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
