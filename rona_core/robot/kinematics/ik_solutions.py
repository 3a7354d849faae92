"""What inverse kinematics answers: eight labelled branches, and how far each is from trouble."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.geometry.arrays import Bools, Floats

N_JOINTS = 6
N_BRANCHES = 8
CHUNK = 1024  # poses worked on together, so that intermediate arrays stay in the cache
ROUNDING = 1e-12  # how far a cosine may exceed 1 and still count as a stretched arm


@dataclass(frozen=True, slots=True)
class Branch:
    """One of the eight ways to reach a pose."""

    shoulder: Literal["front", "back"]  # wrist before or behind axis 1, seen by joint 1
    elbow: Literal[
        "above", "below"
    ]  # of the line from shoulder to wrist, while that leans forwards
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

    def __len__(self) -> int:
        return len(self.qs_rad)

    @property
    def sin_elbow(self) -> Floats:
        """Least |sin q3| (n,) of the branches that reach; all are equal for a spherical wrist."""
        if not self.sin_elbows.strides[1]:
            return self.sin_elbows[:, 0]  # one value stands for all branches
        least = np.where(self.valid, self.sin_elbows, 1.0).min(axis=1)
        return np.where(self.valid.any(axis=1), least, self.sin_elbows.min(axis=1))

    @property
    def reach_mm(self) -> Floats:
        """Most room of reach (n,) of any branch; all are equal for a spherical wrist."""
        if not self.reaches_mm.strides[1]:
            return self.reaches_mm[:, 0]
        return self.reaches_mm.max(axis=1)


def sealed(array: Floats) -> Floats:
    """Return an array that nobody may write to, as it lies in memory (a view stays a view)."""
    array.setflags(write=False)
    return array
