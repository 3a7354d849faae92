"""A timed motion of the joints, and its digest."""

import hashlib
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rona_core.geometry.arrays import Floats, readonly

SAMPLE_S = 0.02  # time between samples of a motion


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


def sampled_motion(qs_rad: Floats) -> Trajectory:
    """Return samples (n, 6), ``SAMPLE_S`` apart, as a motion that is no scan."""
    times_s = np.arange(len(qs_rad), dtype=np.float64) * SAMPLE_S
    return Trajectory(
        readonly(times_s), readonly(qs_rad), 0.0, 0.0, readonly(np.zeros(len(qs_rad)))
    )


def motion_digest(
    robot: str, times_s: Floats, qs_rad: Floats, obstacles: str = "", tolerances: str = ""
) -> str:
    """Return the SHA-256 of a motion and of what it was verified for, as hexadecimal digits.

    Args:
        robot: Digest of the robot.
        times_s: Times (n,).
        qs_rad: Joint angles (n, 6), or (n, m, 6) of a motion with m corrections.
        obstacles: Digest of what stands around; "" where that was not looked at.
        tolerances: Digest of what the verifier insisted on; "" in files of earlier versions.
    """
    stated = (robot, obstacles, tolerances) if tolerances else (robot, obstacles)
    digest = hashlib.sha256("\n".join(stated).encode())
    for array in (times_s, qs_rad):
        exact = np.ascontiguousarray(array, dtype="<f8")
        digest.update(str(exact.shape).encode())
        digest.update(exact.tobytes())
    return digest.hexdigest()
