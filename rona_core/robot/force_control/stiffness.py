"""How stiff the contact is, learnt while touching down and watched while scanning."""

import math

import numpy as np

from rona_core.devices.limits import require
from rona_core.geometry.arrays import clamped

LOWEST, HIGHEST = 0.1, 400.0  # N/mm that are believed
HIGH_PASS_S = 0.15  # slower motion follows the surface and says nothing of the spring
MEMORY_S = 0.5
LEAST_MOTION_MM = 0.02  # rms, below which only noise is compared
LEAST_CORRELATION = 0.8  # between force and travel; following a surface they are out of step
RISE_S = 0.1  # a stiffer contact is believed at once; a softer one after the next touch-down
NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0)  # n, z, F, zz, zF of a touch-down that has not begun


class StiffnessEstimate:
    """Stiffness in N/mm from pressing force and place of the probe along the tool axis.

    Touching down on a surface that keeps still, force over place is a line: its slope counts.
    Afterwards travel and force are compared above 1 Hz. Where the robot follows a surface, force
    and travel are a quarter of a period apart and tell nothing; where the loop begins to ring,
    they go together, and their ratio is the stiffness. What they say can only be too low, because
    part of the travel follows the surface: so it raises the estimate and never lowers it.
    """

    def __init__(self, expected_n_per_mm: float, period_s: float) -> None:
        """Start from what is expected before anything is known."""
        require(LOWEST <= expected_n_per_mm <= HIGHEST, "stiffness must be 0.1 to 400 N/mm")
        self.n_per_mm = expected_n_per_mm
        self._keep = float(np.exp(-period_s / HIGH_PASS_S))
        self._fade = float(np.exp(-period_s / MEMORY_S))
        self._rise = 1.0 - float(np.exp(-period_s / RISE_S))
        self._sums = NOTHING
        self._last: tuple[float, float] | None = None
        self._high = (0.0, 0.0)
        self._moments = (0.0, 0.0, 0.0)

    def touching(self, place_mm: float, force_n: float) -> None:
        """Learn from one step of the touch-down; ``place_mm`` grows into the surface."""
        z, f = place_mm, force_n
        n, sz, sf, szz, szf = self._sums
        n, sz, sf, szz, szf = n + 1.0, sz + z, sf + f, szz + z * z, szf + z * f
        self._sums = n, sz, sf, szz, szf
        spread = n * szz - sz**2
        if n >= 3 and spread > (n * LEAST_MOTION_MM) ** 2:
            self._believe((n * szf - sz * sf) / spread)

    def touch_again(self) -> None:
        """Forget the line of the last touch-down, not what it taught."""
        self._sums = NOTHING
        self._last = None

    def watching(self, travel_mm: float, force_n: float) -> None:
        """Learn from one step of the scan."""
        if self._last is not None:
            high_z = self._keep * (self._high[0] + travel_mm - self._last[0])
            high_f = self._keep * (self._high[1] + force_n - self._last[1])
            self._high = high_z, high_f
            zz, zf, ff = self._moments
            self._moments = (
                self._fade * zz + high_z * high_z,
                self._fade * zf + high_z * high_f,
                self._fade * ff + high_f * high_f,
            )
            self._judge()
        self._last = travel_mm, force_n

    def _judge(self) -> None:
        zz, zf, ff = self._moments
        weight = 1.0 / (1.0 - self._fade)
        if zz < weight * LEAST_MOTION_MM**2 or zf < LEAST_CORRELATION * math.sqrt(zz * ff):
            return
        seen = zf / zz
        if seen > self.n_per_mm:
            self._believe(self.n_per_mm + self._rise * (seen - self.n_per_mm))

    def _believe(self, n_per_mm: float) -> None:
        self.n_per_mm = clamped(n_per_mm, LOWEST, HIGHEST)
