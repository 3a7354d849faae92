"""A six-joint arm: its interface, and what the closed-form solutions of all builds share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from math import cos, sin
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_floats
from rona_core.geometry.pose import Poses

N_JOINTS = 6
N_BRANCHES = 8
CHUNK = 1024  # poses worked on together, so that intermediate arrays stay in the cache
ROUNDING = 1e-12  # how far a cosine may exceed 1 and still count as a stretched arm


@dataclass(frozen=True, slots=True)
class Branch:
    """One of the eight ways to reach a pose."""

    shoulder: Literal["front", "back"]  # wrist before or behind axis 1, seen by joint 1
    elbow: Literal["above", "below"]  # of the line from shoulder to wrist, seen leaning forwards
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

    A branch that cannot reach its pose has ``valid`` false; its angles then point the stretched
    (or folded) arm at it. Angles are principal values, within [-pi, pi]: each may be shifted by
    full turns where limits allow.

    The determinant of the Jacobian is a product of lengths, the sines of elbow and wrist and the
    distance of the wrist: it vanishes where one of these three does, and nowhere else.
    """

    qs_rad: Floats  # (n, 8, 6) in the order of BRANCHES; contiguous along n
    valid: Bools  # (n, 8) the pose can be reached; joint limits are not looked at
    sin_elbows: Floats  # (n, 8) |sin q3|
    sin_wrist: Floats  # (n, 8) |sin q5|
    wrist_distance_mm: Floats  # (n,) wrist centre to axis 1, seen along axis 2
    reaches_mm: Floats  # (n, 8) room left to the nearer end of the reach; negative if outside

    def __post_init__(self) -> None:
        for field in fields(self):
            getattr(self, field.name).setflags(write=False)

    def __len__(self) -> int:
        return len(self.qs_rad)


class Arm(Protocol):
    """The kinematics of a six-joint arm, whatever its build."""

    def forward(self, qs_rad: ArrayLike) -> Poses:
        """Return ``Ts_base_flange`` for joint angles (n, 6) in radians."""
        ...

    def up_flange(self, q_rad: Floats) -> Floats:
        """Return z of ``base`` (3,) in ``flange`` for one posture (6,): against gravity.

        A control loop wants it every period: it takes a tenth of the time of ``forward``, and
        nothing is checked.
        """
        ...

    def inverse(self, Ts_base_flange: Poses) -> IkSolutions:
        """Return every joint vector that brings the flange to each pose."""
        ...

    def link_frames(self, qs_rad: Floats) -> tuple[Floats, Floats]:
        """Return base and the six link frames in ``base`` for joint angles (n, 6).

        Rotations (n, 7, 3, 3) and positions (n, 7, 3).
        """
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


def as_posture(q_rad: ArrayLike, *, name: str = "q_rad") -> Floats:
    """Return one joint vector (6,) in radians; raise InvalidInputError as ``as_joints`` does."""
    return as_joints(np.atleast_2d(as_floats(q_rad, name=name)), name=name)[0]


def wrapped(angles_rad: Floats) -> Floats:
    """Return angles within [-pi, pi], those already inside unchanged."""
    return angles_rad - 2.0 * np.pi * np.round(angles_rad / (2.0 * np.pi))


def opposite(angles_rad: Floats) -> Floats:
    """Return angles half a turn away, within [-pi, pi]."""
    return angles_rad - np.copysign(np.pi, angles_rad)


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


def up_after_turns(angles_rad: Sequence[float]) -> Floats:
    """Return z of the first frame (3,) in the last one, turned about y and z in turn, y first."""
    x, y, z = 0.0, 0.0, 1.0  # three numbers: quicker than arrays
    for i, angle_rad in enumerate(angles_rad):
        c, s = cos(angle_rad), sin(angle_rad)
        if i % 2:
            x, y = x * c + y * s, y * c - x * s
        else:
            x, z = x * c - z * s, x * s + z * c
    return np.array((x, y, z))


def elbow_cosine(squared: Floats, upper_mm: float, fore_mm: float) -> tuple[Floats, Floats]:
    """Return cos q3 by the law of cosines, and the room (n,) to the nearer end of the reach.

    The cosine is beyond [-1, 1] where the wrist, at the root of ``squared`` (n,) from the
    shoulder, is out of reach of the two links.
    """
    span = np.sqrt(squared)
    reach = np.minimum(upper_mm + fore_mm - span, span - abs(upper_mm - fore_mm))
    return (squared - upper_mm**2 - fore_mm**2) / (2.0 * upper_mm * fore_mm), reach


def link_frames(
    steps: Sequence[tuple[Callable[[Floats], Floats], Floats, tuple[float, float, float]]],
) -> tuple[Floats, Floats]:
    """Return rotations (n, 7, 3, 3) and positions (n, 7, 3) of base and links.

    Each step is a shift in the frame before, then a turn: its function, its angles (n,), the shift.
    """
    n = len(steps[0][1])
    rotations, positions = np.zeros((n, len(steps) + 1, 3, 3)), np.zeros((n, len(steps) + 1, 3))
    rotations[:, 0] = np.eye(3)
    for i, (turn, angles_rad, shift_mm) in enumerate(steps):
        positions[:, i + 1] = positions[:, i] + rotations[:, i] @ np.array(shift_mm)
        rotations[:, i + 1] = rotations[:, i] @ turn(angles_rad)
    return rotations, positions
