"""Contact dynamics: Kelvin-Voigt spring, sensor filter and lag of the corrected axis.

Between two steps of the control loop the robot and the sensor are linear, so their states are
carried on in closed form; force is looked at every millisecond, because it cannot pull.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from rona_core.devices.limits import require
from rona_core.devices.wrench import JR3
from rona_core.geometry.arrays import Floats
from rona_core.virtual.acoustics.delay_line import LINE_N_PER_MM

INNER_S = 0.001  # time between looks at the spring
DAMPING_S = 0.005  # time constant of its creep, over which its force builds up


class LaggingAxis:
    """Correction of a robot that takes up speeds after a delay and a time constant.

    Speeds are commanded one after another; travel and speed at any later time follow in closed
    form. It rests at 0 until the first command arrives.
    """

    def __init__(self, delay_s: float, lag_s: float, limit_mm: float = np.inf) -> None:
        """Rest at 0."""
        self.delay_s, self.lag_s, self.limit_mm = delay_s, lag_s, limit_mm
        # knots: time from which a commanded speed holds, travel and speed reached there
        self._times: list[float] = [-np.inf]
        self._knots: list[tuple[float, float, float]] = [(0.0, 0.0, 0.0)]

    def command(self, time_s: float, velocity_mm_per_s: float) -> None:
        """Ask for a speed at some time; times must grow."""
        at_s = time_s + self.delay_s
        travel, speed = self._state(at_s)
        self._times.append(at_s)
        self._knots.append((travel, speed, velocity_mm_per_s))

    def travel_mm(self, time_s: float) -> float:
        """Return the correction at some time, kept within the limit."""
        i = bisect_right(self._times, time_s) - 1
        travel, speed, commanded = self._knots[i]
        if i:
            elapsed = time_s - self._times[i]
            decay = math.exp(-elapsed / self.lag_s)
            travel += commanded * elapsed + (speed - commanded) * self.lag_s * (1.0 - decay)
        return max(-self.limit_mm, min(self.limit_mm, travel))

    def travels_mm(self, times_s: Sequence[float]) -> list[float]:
        """Return ``travel_mm`` at ascending times, at least one.

        In one go, for a call takes as long as the sum.
        """
        times, lag_s, limit_mm, exp = self._times, self.lag_s, self.limit_mm, math.exp
        i, newest, until_s = -1, len(times) - 1, -math.inf
        travel = behind_mm = commanded = 0.0
        found: list[float] = []
        for time_s in times_s:
            if time_s >= until_s:
                i = bisect_right(times, time_s, max(i, 0)) - 1
                until_s = times[i + 1] if i < newest else math.inf
                travel, speed, commanded = self._knots[i]
                behind_mm = (speed - commanded) * lag_s
            reached = travel
            if i:
                elapsed = time_s - times[i]
                reached += commanded * elapsed + behind_mm * (1.0 - exp(-elapsed / lag_s))
            if abs(reached) > limit_mm:
                reached = math.copysign(limit_mm, reached)
            found.append(reached)
        return found

    def _state(self, time_s: float) -> tuple[float, float]:
        i = bisect_right(self._times, time_s) - 1
        travel, speed, commanded = self._knots[i]
        if i == 0:
            return travel, speed
        elapsed = time_s - self._times[i]
        decay = math.exp(-elapsed / self.lag_s)
        moved_mm = commanded * elapsed + (speed - commanded) * self.lag_s * (1.0 - decay)
        return travel + moved_mm, commanded + (speed - commanded) * decay


class ContactSpring:
    """Pressing force of a Kelvin-Voigt contact, as a first-order filter shows it."""

    def __init__(
        self,
        stiffness_n_per_mm: float = LINE_N_PER_MM,
        *,
        damping_s: float = DAMPING_S,
        cutoff_hz: float = JR3.cutoff_hz,
    ) -> None:
        """Begin without contact; ``damping_s`` is the damping over the stiffness."""
        require(stiffness_n_per_mm > 0.0, "stiffness_n_per_mm must be positive")
        self.stiffness_n_per_mm = stiffness_n_per_mm
        self._damping_s = damping_s
        self._keep = float(np.exp(-2.0 * np.pi * cutoff_hz * INNER_S))
        self._weights: Floats = np.zeros(0)  # of the newest looks in what the filter shows
        self._last_mm = -np.inf
        self.force_n = 0.0  # of the spring
        self.shown_n = 0.0  # behind the filter

    def advance(self, pressed_mm: Floats) -> float:
        """Go on by one look for each depth (n,) that the face is pressed in; return what shows.

        Negative depths are gaps.
        """
        force = pressed_mm.copy()  # in place: stiffness times depth and damping times its rate
        force[1:] -= pressed_mm[:-1]
        force[0] -= max(self._last_mm, pressed_mm[0] - 1.0)
        force /= INNER_S
        force *= self._damping_s
        force += pressed_mm
        force *= self.stiffness_n_per_mm
        force = np.where(pressed_mm > 0.0, np.maximum(force, 0.0, out=force), 0.0)
        n = len(force)
        if n != len(self._weights):  # every step of a control loop has as many looks
            powers = np.power(self._keep, np.arange(n - 1, -1, -1), dtype=np.float64)
            self._weights = (1.0 - self._keep) * powers
        self.shown_n = float(self._keep**n * self.shown_n + self._weights @ force)
        self._last_mm, self.force_n = float(pressed_mm[-1]), float(force[-1])
        return self.shown_n
