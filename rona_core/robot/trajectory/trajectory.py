"""A timed motion of the joints, and its digest."""

import hashlib
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rona_core.geometry.arrays import Floats


class TimedMotion(Protocol):
    """Joint angles (n, 6) in radians at times (n,) in seconds."""

    @property
    def times_s(self) -> Floats: ...  # noqa: D102
    @property
    def qs_rad(self) -> Floats: ...  # noqa: D102


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A timed motion of the joints, at rest at both ends; linear between its samples."""

    times_s: Floats  # (n,) from 0
    qs_rad: Floats  # (n, 6)
    scan_start_s: float  # the probe touches the first path point
    scan_end_s: float  # it reaches the last one
    path_mm: Floats  # (n,) way along the scan path: 0 before the scan, its length afterwards

    @property
    def duration_s(self) -> float:
        """Time from first to last sample."""
        return float(self.times_s[-1] - self.times_s[0])


def motion_digest(model: str, motion: TimedMotion, obstacles: str = "") -> str:
    """Return the SHA-256 of a motion, its robot and what stands around, as hexadecimal digits."""
    digest = hashlib.sha256(f"{model}\n{obstacles}".encode())
    for array in (motion.times_s, motion.qs_rad):
        exact = np.ascontiguousarray(array, dtype="<f8")
        digest.update(str(exact.shape).encode())
        digest.update(exact.tobytes())
    return digest.hexdigest()
