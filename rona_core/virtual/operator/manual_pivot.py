"""Manual pivot: a pointer that a user turns about its resting tip during a capture."""

import threading

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.virtual.pointer_motion import BandLimitedNoise, HandMotion

FOLLOW_S = 0.08  # lag of the hand behind the command
MAX_TURN_RAD_S = np.deg2rad(120.0)


class ManualPivot:
    """Manual pivot: a pointer at rest, turned about its tip towards the rotation commanded last.

    A rotation is relative to the pose at the start of the capture, along the axes of ``base``. The
    hand follows smoothly, at a bounded angular speed. What was asked for once stays as it was.
    """

    def __init__(self, rest: HandMotion, tremor: BandLimitedNoise) -> None:
        """Start from ``rest``; ``tremor`` are angles in rad about the axes of ``base``."""
        self.pointer = rest.pointer
        self.duration_s = rest.duration_s
        self._tip_base = rest.tip_base(0.0)
        self._shaft_base = rest.shaft_base(0.0)
        self._T_base_pointermarker = rest.Ts_base_pointermarker(np.zeros(1))[0]
        self._tremor = tremor
        self._lock = threading.Lock()
        self._wanted = Rotation.identity()
        self._times_s = [0.0]
        self._turns = [Rotation.identity()]
        self._ended = False

    @property
    def ended(self) -> bool:
        """Whether the manual pivot has ended."""
        return self._ended

    def end(self) -> None:
        """End the manual pivot; a second call does nothing."""
        self._ended = True

    def turn(self, turn_base: Floats) -> None:
        """Command a rotation (3, 3); the last one counts."""
        wanted = Rotation.from_matrix(turn_base)
        with self._lock:
            self._wanted = wanted

    def tip_base(self, time_s: float) -> Floats:
        """Return the true tip (3,): it rests."""
        return self._tip_base

    def shaft_base(self, time_s: float) -> Floats:
        """Return the unit direction (3,) from the tip to the hand."""
        return self._turn_at(time_s).apply(self._shaft_base)

    def Ts_base_pointermarker(self, times_s: Floats) -> Poses:  # noqa: N802 (frame grammar)
        """Return the true poses of the pointer's marker at times (n,)."""
        rest = self._T_base_pointermarker
        turns = np.stack([self._turn_at(float(time_s)).as_matrix() for time_s in times_s])
        lever = rest.translation - self._tip_base
        return Poses(turns @ rest.rotation, self._tip_base + turns @ lever)

    def _turn_at(self, time_s: float) -> Rotation:
        shake = self._tremor.at(np.array([time_s]))[0]
        with self._lock:
            return Rotation.from_rotvec(shake) * self._followed(time_s)

    def _followed(self, time_s: float) -> Rotation:
        last_s, last = self._times_s[-1], self._turns[-1]
        if time_s <= last_s:
            return self._past(time_s)
        rotation_vector = (self._wanted * last.inv()).as_rotvec()
        angle = float(np.linalg.norm(rotation_vector))
        passed_s = time_s - last_s
        going = min(angle * -np.expm1(-passed_s / FOLLOW_S), MAX_TURN_RAD_S * passed_s)
        now = (
            last
            if angle < 1e-12
            else Rotation.from_rotvec(rotation_vector * (going / angle)) * last
        )
        self._times_s.append(time_s)
        self._turns.append(now)
        return now

    def _past(self, time_s: float) -> Rotation:
        """Return the turn at a time gone by, between the two that are known beside it."""
        after = int(np.searchsorted(self._times_s, time_s))
        if after == 0 or self._times_s[after] == time_s:
            return self._turns[after]
        before_s, after_s = self._times_s[after - 1], self._times_s[after]
        rotation_vector = (self._turns[after] * self._turns[after - 1].inv()).as_rotvec()
        share = (time_s - before_s) / (after_s - before_s)
        return Rotation.from_rotvec(share * rotation_vector) * self._turns[after - 1]
