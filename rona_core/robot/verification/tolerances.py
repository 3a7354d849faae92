"""Tolerances of the verifier, how densely it looks at a motion, and the digest of both.

All numbers that decide whether a motion is certified stand here, but for the distances that are to
be kept: those belong to the obstacles. A certificate made with other numbers certifies nothing.
"""

import hashlib
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from rona_core.devices.limits import require

DENSITY = 4  # poses looked at for each sample of the motion
HALVINGS = 6  # of a step between samples at most, where parts come near each other
EXACT = 1e-9  # rounding that is forgiven
EXCESS = 1e-6  # share of a speed or acceleration limit that rounding may add
SHORTEST_S = 1e-4  # least time between samples
NEAR_MM = 60.0  # within this of a path point, the tip must stay outside the bone
SIDEWAYS_MM = 0.05  # a move of a burr in the air that goes farther must be over the bone
SAME_MM = 1e-6  # of way along a cutting path


@dataclass(frozen=True, slots=True)
class Tolerances:
    """What the verifier insists on in every motion."""

    step_rad: float = float(np.deg2rad(10.0))  # largest joint step between samples
    position_mm: float = 0.3  # of the probe face from the path
    axis_rad: float = float(np.deg2rad(0.5))  # of the probe axis from that of the path
    roll_rad: float = float(np.deg2rad(0.5))  # about the probe axis
    singular_rad: float = float(np.deg2rad(4.9))  # of elbow and wrist from straight, on the path
    shoulder_mm: float = 29.0  # of the wrist centre from axis 1, on the path
    speed_excess: float = 0.01  # over the scan speed that was asked for, also of the probe itself
    uneven_excess: float = 0.1  # likewise, between samples: the probe is uneven, joints are linear
    dip_mm: float = 0.5  # into the bone while approaching or leaving
    chord_mm: float = 0.1  # of the tool between samples from the straight line between them
    tool_speed_mm_per_s: float = 250.0  # of the tip; what robots near people are held to
    path_acceleration_mm_per_s2: float = 250.0  # of the probe while it scans

    def __post_init__(self) -> None:
        for name in self.__slots__:
            require(getattr(self, name) > 0.0, f"{name} must be positive")


@dataclass(frozen=True, slots=True)
class CuttingTolerances:
    """What the verifier insists on in a cutting motion."""

    motion: Tolerances = field(default_factory=Tolerances)
    position_mm: float = 0.1  # of the tip from the path
    below_mm: float = 0.05  # of the lowest place of the burr below that of the path, while it cuts
    axis_rad: float = float(np.deg2rad(0.5))
    feed_excess: float = 0.01
    way_mm: float = 8.0  # from one sample to the next
    posture_rad: float = float(np.deg2rad(0.01))  # of a rest from where the way home begins


@lru_cache(maxsize=8)  # asked for whenever a plan is shown
def tolerances_digest(insisted: Tolerances | CuttingTolerances) -> str:
    """Return the SHA-256 of tolerances and of the constants above, as hexadecimal digits.

    Every number counts to the last bit, and so does whether cutting is judged.
    """
    constants = {name: value for name, value in globals().items() if name.isupper()}
    return hashlib.sha256(f"{insisted!r}\n{sorted(constants.items())}".encode()).hexdigest()
