"""Verification on landmarks: the same places by the robot, and by tracker and pointer.

The robot's tip once touched each landmark, so that the robot says where it is; the tracked pointer
touches it again. Each distance is held against what is predicted of it. See
docs/algorithms/navigation/landmarks.md.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats

LEAST = 3  # landmarks that must be seen: fewer do not show a turn


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkCheck:
    """Landmarks as robot and pointer see them, in ``base``, and how far apart they should be."""

    names: tuple[str, ...]  # n
    robot_base: Floats  # (n, 3)
    pointer_base: Floats  # (n, 3); where the pointer was not seen, the place of the robot
    seen: Bools  # (n,)
    sigmas_mm: Floats  # (n,) predicted 3D RMS of each distance; 0 where the pointer was not seen
    sigmas: float  # no landmark may be farther off than so many times what is predicted of it
    limit_mm: float  # nor farther than this, whatever is predicted
    # why the robot seems to err more than assumed; empty where nothing speaks for it
    contradiction: str = field(default="", metadata={"omit_empty": True})

    @property
    def distances_mm(self) -> Floats:
        """Distances (n,) between both; 0 where the pointer was not seen."""
        return np.linalg.norm(self.pointer_base - self.robot_base, axis=1)

    @property
    def limits_mm(self) -> Floats:
        """What each distance (n,) may be."""
        return np.minimum(self.sigmas * self.sigmas_mm, self.limit_mm)

    @property
    def rms_mm(self) -> float:
        """RMS of the distances of those that were seen."""
        return float(np.sqrt((self.distances_mm[self.seen] ** 2).mean()))

    @property
    def expected_rms_mm(self) -> float:
        """What is predicted of it."""
        return float(np.sqrt((self.sigmas_mm[self.seen] ** 2).mean()))

    @property
    def verdict(self) -> Literal["pass", "fail"]:
        """Whether the robot may follow a path that tracker and pointer have shown."""
        return "fail" if self.reasons else "pass"

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it may not, the worst landmark first; empty where it may."""
        distances, limits = self.distances_mm, self.limits_mm
        missed = np.flatnonzero(self.seen & (distances > limits))
        return tuple(
            f"landmark {self.names[i]!r} is {distances[i]:.2f} mm off, at most {limits[i]:.2f} mm "
            "are allowed"
            for i in missed[np.argsort(-distances[missed])]
        )


def require_enough(seen: Bools) -> None:
    """Raise DegenerateGeometryError where the pointer was seen on too few landmarks."""
    count = int(seen.sum())
    if count < LEAST:
        raise DegenerateGeometryError(
            f"the tracker saw the pointer on {count} of {len(seen)} landmarks, {LEAST} are the "
            "least: uncover it and verify again"
        )
