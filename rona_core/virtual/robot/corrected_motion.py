"""Corrected motion of the virtual robot: a share of its speed, corrections along the tool axis."""

import math
from bisect import bisect_left, bisect_right

import numpy as np

from rona_core.devices.protocols import Clock
from rona_core.geometry.arrays import Floats
from rona_core.virtual.robot.contact_dynamics import LaggingAxis


class CorrectedMotion:
    """Joint angles over time: a motion driven at some share of its speed, with a correction.

    What was commanded until now fixes the whole past, so any earlier time may be asked for.
    """

    def __init__(
        self,
        start_s: float,
        times_s: Floats,
        qs_rad: Floats,
        travels_mm: Floats,
        axis: LaggingAxis,
    ) -> None:
        """Stand at the beginning of the motion ``times_s`` (n,), ``qs_rad`` (n, m, 6)."""
        self.motion_times_s, self.qs_rad, self.travels_mm = times_s, qs_rad, travels_mm
        self.guided = np.ptp(qs_rad, axis=1).max(axis=1) > 0.0  # a correction changes something
        self._axis, self._end_s = axis, float(times_s[-1])
        self._times: list[float] = times_s.tolist()
        self._steps_rad = np.diff(qs_rad, axis=0)
        self._levels: list[float] = travels_mm.tolist()
        # of each command: when it came, what had been reached, and the share of speed from then on
        self._knots: list[tuple[float, float, float]] = [(start_s, float(times_s[0]), 0.0)]
        self._knot_times = [start_s]
        self._weights = 1.0 / np.array(
            [np.prod(own - np.delete(travels_mm, i)) for i, own in enumerate(travels_mm)]
        )
        self.stopped_s = np.inf
        self.over = False

    def command(self, time_s: float, velocity_mm_per_s: float, feed_share: float) -> None:
        """Correct at this speed and drive at this share from now on."""
        self._axis.command(time_s, velocity_mm_per_s)
        self._knots.append((time_s, self.reached_s(time_s), feed_share))
        self._knot_times.append(time_s)

    def reached_s(self, time_s: float) -> float:
        """Return the time of the motion that has been reached at some time of the capture."""
        if time_s > self.stopped_s or time_s == math.inf:
            time_s = self._until(time_s)
        i = bisect_right(self._knot_times, time_s) - 1
        since_s, reached_s, share = self._knots[i] if i > 0 else self._knots[0]
        return min(reached_s + share * max(time_s - since_s, 0.0), self._end_s)

    def travel_mm(self, time_s: float) -> float:
        """Return the correction at some time of the capture."""
        if time_s > self.stopped_s or time_s == math.inf:
            time_s = self._until(time_s)
        return self._axis.travel_mm(time_s)

    def looks(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return ``reached_s`` and ``travel_mm`` (n,) at ascending times (n,) of the capture."""
        times = np.minimum(times_s, self.stopped_s).tolist()
        begins, newest = self._knot_times, len(self._knots) - 1
        i, until_s = 0, -math.inf
        since_s = reached_s = share = 0.0
        reached: list[float] = []
        for time_s in times:
            if time_s >= until_s:
                i = max(bisect_right(begins, time_s, i) - 1, 0)
                until_s = begins[i + 1] if i < newest else math.inf
                since_s, reached_s, share = self._knots[i]
            ago_s = time_s - since_s
            reached.append(reached_s + share * ago_s if ago_s > 0.0 else reached_s)
        return np.minimum(reached, self._end_s), np.array(self._axis.travels_mm(times))

    def place_of(self, reached_s: float) -> int:
        """Return the first sample of the motion that is no earlier than a time of it."""
        return bisect_left(self._times, reached_s)

    def _until(self, time_s: float) -> float:
        """Return a time, at latest that of the stop or of the last command."""
        time_s = min(time_s, self.stopped_s)
        return time_s if math.isfinite(time_s) else self._knots[-1][0]

    def at(self, times_s: Floats) -> Floats:
        """Return the joint angles (n, 6) at times (n,) of the capture: ``at_one`` for each."""
        reached = np.array([self.reached_s(time_s) for time_s in times_s.tolist()])
        travels_mm = np.array([self.travel_mm(time_s) for time_s in times_s.tolist()])
        knots = self.motion_times_s
        i = np.clip(np.searchsorted(knots, reached, side="right") - 1, 0, len(knots) - 2)
        share = (reached - knots[i]) / (knots[i + 1] - knots[i])
        sheets = self.qs_rad[i] + share[:, None, None] * (self.qs_rad[i + 1] - self.qs_rad[i])
        apart = travels_mm[:, None] - self.travels_mm
        level = apart == 0.0
        terms = self._weights / np.where(level, 1.0, apart)
        qs = (terms[:, None] @ sheets)[:, 0] / np.add.reduce(terms, axis=1)[:, None]
        row, number = np.nonzero(level)
        qs[row] = sheets[row, number]
        return qs

    def at_one(self, time_s: float) -> Floats:
        """Return the joint angles (6,) at some time of the capture."""
        times, reached = self._times, self.reached_s(time_s)
        i = min(max(bisect_right(times, reached) - 1, 0), len(times) - 2)
        share = (reached - times[i]) / (times[i + 1] - times[i])
        sheet = self.qs_rad[i] + share * self._steps_rad[i]
        travel_mm = self.travel_mm(time_s)
        if travel_mm in self._levels:
            return sheet[self._levels.index(travel_mm)]
        # the polynomial through the levels, barycentric
        terms = self._weights / (travel_mm - self.travels_mm)
        return terms @ sheet / np.add.reduce(terms)

    @property
    def end_s(self) -> float:
        """Time at which the robot comes to rest, infinite while it is open."""
        since_s, reached_s, share = self._knots[-1]
        left_s = self._end_s - reached_s
        arrival_s = since_s + left_s / share if share > 0.0 else np.inf
        return min(since_s if left_s <= 0.0 else arrival_s, self.stopped_s)


class VirtualGuidedMotion:
    """Satisfies ``devices.protocols.GuidedMotion``."""

    def __init__(self, course: CorrectedMotion, clock: Clock, latency_s: float) -> None:
        self._course, self._clock, self._latency_s = course, clock, latency_s

    def done(self) -> bool:
        """Return whether the motion has ended, by arriving or by being stopped."""
        return self._course.over or self._clock.now() >= self._course.end_s

    def progress(self) -> float:
        """Return the share that is done, 0 to 1."""
        reached = self._course.reached_s(self._clock.now())
        return float(np.clip(reached / self._course.motion_times_s[-1], 0.0, 1.0))

    def correct(self, velocity_mm_per_s: float, feed_share: float) -> None:
        """Correct at this speed along the tool axis, and drive at this share of the speed."""
        if not self.done():
            self._course.command(self._clock.now(), velocity_mm_per_s, feed_share)

    def reached_s(self) -> float:
        """Return the time of the motion that has been reached."""
        return self._course.reached_s(self._clock.now())

    def travel_mm(self) -> float:
        """Return the correction, as late as everything that the robot reports."""
        return self._course.travel_mm(self._clock.now() - self._latency_s)
