"""Joint limits, and full turns of joints whose range is more than one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_floats, readonly

TURN_RAD = 2.0 * np.pi
NEARLY_ROUND_RAD = np.deg2rad(300.0)  # a joint with this range may pass the far side at +-180
EDGE_RAD = 1e-9  # rounding that is forgiven at a limit


@dataclass(frozen=True, slots=True, eq=False)
class JointLimits:
    """Position, speed and acceleration limits of the six joints; every array is (6,)."""

    lower_rad: Floats
    upper_rad: Floats
    speed_rad_per_s: Floats
    acceleration_rad_per_s2: Floats

    def __post_init__(self) -> None:
        for name in ("lower_rad", "upper_rad", "speed_rad_per_s", "acceleration_rad_per_s2"):
            values = as_floats(getattr(self, name), name=name)
            if values.shape != (6,):
                raise InvalidInputError(f"{name} must have shape (6,), not {values.shape}")
            object.__setattr__(self, name, readonly(values))
        if (self.lower_rad >= self.upper_rad).any():
            raise InvalidInputError("each lower joint limit must lie below the upper one")
        if min(self.speed_rad_per_s.min(), self.acceleration_rad_per_s2.min()) <= 0.0:
            raise InvalidInputError("speed and acceleration limits must be positive")

    def clearance_rad(self, qs_rad: ArrayLike) -> Floats:
        """Return the distance (..., 6) to the nearer limit; negative outside."""
        qs = np.asarray(qs_rad, dtype=np.float64)
        return np.minimum(qs - self.lower_rad, self.upper_rad - qs)

    def multi_turn(self) -> Bools:
        """Return which joints (6,) have a range of more than one turn."""
        return self.upper_rad - self.lower_rad > TURN_RAD + EDGE_RAD

    def spinning(self) -> tuple[int, ...]:
        """Return the joints (0 to 5) for which +180 and -180 degrees are one place on a path."""
        return tuple(np.flatnonzero(self.upper_rad - self.lower_rad >= NEARLY_ROUND_RAD).tolist())


def shift_to_fit(angles_rad: Floats, lower_rad: float, upper_rad: float) -> Floats:
    """Return continuous angles (n, b) of one joint, each column shifted by full turns.

    A column that fits between the limits is shifted to where its clearance is largest, any other
    one to where it stays inside for longest from the start.
    """
    middle = (lower_rad + upper_rad) / 2.0
    low, high = angles_rad.min(axis=0), angles_rad.max(axis=0)
    turns = np.round((middle - (low + high) / 2.0) / TURN_RAD)
    shifted = angles_rad + TURN_RAD * turns
    outside = (low + TURN_RAD * turns < lower_rad) | (high + TURN_RAD * turns > upper_rad)
    if outside.any():
        shifted[:, outside] = _longest_inside(angles_rad[:, outside], lower_rad, upper_rad)
    return shifted


def _longest_inside(angles_rad: Floats, lower_rad: float, upper_rad: float) -> Floats:
    """Return curves (n, b), each shifted so that it leaves the limits as late as possible."""
    middle = (lower_rad + upper_rad) / 2.0
    nearest = np.round((middle - angles_rad[0]) / TURN_RAD)
    best, survived = nearest, np.full(angles_rad.shape[1], -1, dtype=np.int64)
    for turns in (nearest, nearest - 1.0, nearest + 1.0):
        candidate = angles_rad + TURN_RAD * turns
        outside = (candidate < lower_rad) | (candidate > upper_rad)
        first = np.where(outside.any(axis=0), outside.argmax(axis=0), len(outside))
        best = np.where(first > survived, turns, best)
        survived = np.maximum(first, survived)
    return angles_rad + TURN_RAD * best
