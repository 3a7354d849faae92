"""Virtual robot: joint angles as a pure function of the capture's clock."""

import math
import threading
from collections.abc import Callable, Hashable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.protocols import Clock
from rona_core.devices.samples import JointSample
from rona_core.devices.settings import ContactSettings, RobotSettings
from rona_core.errors import DeviceError, InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats, clamped, readonly
from rona_core.robot.kinematics.arm import as_joints
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.robot.contact_dynamics import LaggingAxis
from rona_core.virtual.robot.corrected_motion import CorrectedMotion, VirtualGuidedMotion
from rona_core.virtual.robot.seated_motion import Seated

START_TOLERANCE_RAD = float(np.deg2rad(0.5))  # a motion must start where the robot stands
# times (n,), joint angles (n, 6), while the tip is held -> angles (n, 6) that the arm has
Yield = Callable[[Floats, Floats, Seated], Floats]
SPEED_SLACK, ROUNDING_RAD = 1.001, 1e-9  # rounding that is forgiven


@dataclass(slots=True, eq=False)
class _Course:
    """Joint angles (n, 6) over the capture's time (n,), until it is cut short."""

    times_s: Floats
    qs_rad: Floats
    stopped_s: float = np.inf
    over: bool = False  # a new capture has begun since

    def at(self, time_s: ArrayLike) -> Floats:
        """Return the joint angles (..., 6) at times (...); at rest before and after."""
        reached_s = np.minimum(time_s, self.stopped_s)
        return np.stack([np.interp(reached_s, self.times_s, q) for q in self.qs_rad.T], axis=-1)

    def at_one(self, time_s: float) -> Floats:
        """Return the joint angles (6,) at one time: those of ``at``, all joints at once."""
        times, qs = self.times_s, self.qs_rad
        reached_s = min(time_s, self.stopped_s)
        i = int(np.searchsorted(times, reached_s, side="right")) - 1
        if i < 0 or i >= len(times) - 1:
            return qs[max(i, 0)].copy()
        slope = (qs[i + 1] - qs[i]) / (times[i + 1] - times[i])
        return slope * (reached_s - times[i]) + qs[i]

    @property
    def end_s(self) -> float:
        """When the robot comes to rest."""
        return min(float(self.times_s[-1]), self.stopped_s)


class VirtualMotion:
    """A motion under way."""

    def __init__(self, course: _Course, clock: Clock) -> None:
        self._course, self._clock = course, clock

    def done(self) -> bool:
        """Return whether the motion has ended, by arriving or by being stopped."""
        return self._course.over or self._clock.now() >= self._course.end_s

    def progress(self) -> float:
        """Return the share that is done, 0 to 1; it stays where a stop cut it short."""
        course = self._course
        reached_s = course.end_s if self.done() else self._clock.now()
        start_s, planned_s = float(course.times_s[0]), float(course.times_s[-1])
        return clamped((reached_s - start_s) / (planned_s - start_s), 0.0, 1.0)


class VirtualRobot:
    """Satisfies ``devices.protocols.Robot``; calls from several threads are safe."""

    def __init__(self, model: RobotModel, clock: Clock, yields: Yield | None = None) -> None:
        self.model, self._yields = model, yields
        self._clock = clock
        self._lock = threading.RLock()
        self._closed = False
        self._settings, self._ordinal = RobotSettings(latency_ms=0.0), 0
        self._course: _Course | CorrectedMotion = _standing(model.home_rad)

    def begin(self, settings: RobotSettings, ordinal: int) -> None:
        """Stand still where the robot is, at time 0 of capture number ``ordinal``.

        Raises:
            DeviceError: the settings name another robot.
        """
        with self._lock:
            if settings.model != self.model.name:
                raise DeviceError(f"this is a {self.model.name}, not a {settings.model}")
            self._closed = False
            self._settings, self._ordinal = settings, ordinal
            self._rest(self._course.at_one(np.inf))

    def state(self) -> JointSample:
        """Return the joint angles that arrive now: those of a moment ago, as the settings say."""
        with self._lock:
            now_s = self._clock.now()
            late_s, course = self._settings.latency_ms / 1000.0, self._course
            q = readonly(course.at_one(now_s - late_s))
            # it has arrived when its joint angles say so; a stop is reported at once
            end_s = course.end_s + (0.0 if math.isfinite(course.stopped_s) else late_s)
            return JointSample(now_s, q, moving=now_s < end_s)

    def q_at(self, time_s: float) -> Floats:
        """Return the joint angles (6,) at any time of the capture."""
        with self._lock:
            return readonly(self._course.at_one(time_s))

    def qs_at(self, times_s: Floats) -> Floats:
        """Return the joint angles (n, 6) at times (n,) of the capture."""
        with self._lock:
            return self._course.at(times_s)

    def motion_key(self) -> Hashable | None:
        """Return what decides the joint angles to come, None while corrections may come in."""
        with self._lock:
            course = self._course
            return None if isinstance(course, CorrectedMotion) else (course, course.stopped_s)

    def move(self, times_s: ArrayLike, qs_rad: ArrayLike) -> VirtualMotion:
        """Start along joint angles (n, 6) at times (n,), counted from now; linear in between.

        Raises:
            InvalidInputError: arrays of the wrong shape, or times that do not grow.
            DeviceError: the robot is closed or moving, the motion starts elsewhere, or a joint
                limit or speed would be exceeded.
        """
        return self._start(times_s, qs_rad, lambda times, qs: qs)

    def move_seated(
        self, times_s: ArrayLike, qs_rad: ArrayLike, seated_s: tuple[float, float]
    ) -> VirtualMotion:
        """Start a motion (n, 6) as :meth:`move` does, yielding to a seat that holds the tip.

        Raises:
            InvalidInputError, DeviceError: as for :meth:`move`.
            DeviceError: there is no seat beside this robot.
        """
        yields = self._yields
        if yields is None:
            raise DeviceError("there is no seat beside this robot to hold a tip")
        start_s, end_s = (time_s + self._clock.now() for time_s in seated_s)
        seated = Seated(self._ordinal, start_s, end_s)
        return self._start(times_s, qs_rad, lambda times, qs: yields(times, qs, seated))

    def _start(
        self, times_s: ArrayLike, qs_rad: ArrayLike, yielded: Callable[[Floats, Floats], Floats]
    ) -> VirtualMotion:
        """Start along what is left of joint angles (n, 6) once the arm has yielded."""
        qs, times = as_joints(qs_rad), as_floats(times_s, name="times_s")
        if times.shape != (len(qs),) or len(qs) < 2:
            raise InvalidInputError("a motion needs at least 2 joint vectors with a time each")
        if times[0] < 0.0 or (np.diff(times) <= 0.0).any():
            raise InvalidInputError("times_s must grow from 0 on")
        with self._lock:
            now_s = self._clock.now()
            self._refuse(qs, times, now_s)
            course = _Course(times + now_s, yielded(times + now_s, qs))
            self._course = course
            return VirtualMotion(course, self._clock)

    def guide(
        self, times_s: ArrayLike, qs_rad: ArrayLike, travels_mm: ArrayLike
    ) -> VirtualGuidedMotion:
        """Start a motion (n, m, 6) that is driven and corrected by its ``correct``.

        Raises:
            InvalidInputError: arrays of the wrong shape, or times or corrections that do not grow.
            DeviceError: as for :meth:`move`, for any of the corrections.
        """
        times, travels = as_floats(times_s, name="times_s"), as_floats(travels_mm, name="travels")
        qs = as_floats(qs_rad, name="qs_rad")
        if qs.shape != (len(times), len(travels), 6) or len(times) < 2:
            raise InvalidInputError(f"qs_rad must have shape (n, m, 6), not {qs.shape}")
        if (np.diff(times) <= 0.0).any() or (np.diff(travels) <= 0.0).any() or 0.0 not in travels:
            raise InvalidInputError("times_s and travels_mm must grow, and 0 must be among these")
        middle = int(np.flatnonzero(travels == 0.0)[0])
        contact = self._settings.contact or ContactSettings()
        with self._lock:
            now_s = self._clock.now()
            self._refuse(qs[:, middle], times, now_s)
            for level in range(len(travels)):
                self._refuse_limits(qs[:, level])
            limit_mm = float(min(-travels[0], travels[-1]))
            axis = LaggingAxis(contact.delay_ms / 1000.0, contact.lag_ms / 1000.0, limit_mm)
            course = CorrectedMotion(now_s, times, qs, travels, axis)
            self._course = course
            return VirtualGuidedMotion(course, self._clock, self._settings.latency_ms / 1000.0)

    @property
    def guided(self) -> CorrectedMotion | None:
        """The course that is corrected along the tool axis, None while there is none."""
        course = self._course
        return course if isinstance(course, CorrectedMotion) else None

    def place(self, q_rad: ArrayLike) -> None:
        """Stand at these joint angles (6,), as if driven there before the capture.

        Raises:
            DeviceError: outside the joint limits.
        """
        q = as_joints(np.atleast_2d(as_floats(q_rad, name="q_rad")), name="q_rad")
        self._refuse_limits(q)
        with self._lock:
            self._rest(q[0])

    def stop(self) -> None:
        """Stop at once; always allowed, a second call does nothing."""
        with self._lock:
            self._course.stopped_s = min(self._course.end_s, self._clock.now())

    def close(self) -> None:
        """Release the device; a second call does nothing."""
        self.stop()
        with self._lock:
            self._closed = True

    def _rest(self, q_rad: Floats) -> None:
        self._course.over = True
        self._course = _standing(q_rad)

    def _refuse(self, qs: Floats, times: Floats, now_s: float) -> None:
        """Raise DeviceError unless the motion may start now."""
        if self._closed:
            raise DeviceError("the robot is closed")
        if now_s < self._course.end_s:
            raise DeviceError("the robot is still moving; stop it first")
        here = self._course.at_one(now_s)
        gap_rad = np.abs(qs[0] - here)
        if gap_rad.max() > START_TOLERANCE_RAD:
            joint = int(np.argmax(gap_rad))
            raise DeviceError(
                f"the motion starts {np.rad2deg(gap_rad[joint]):.1f}° from where joint "
                f"{joint + 1} stands",
                joint=joint + 1,
            )
        self._refuse_limits(qs)
        speeds = np.abs(np.diff(qs, axis=0)) / np.diff(times)[:, None]
        share = speeds / self.model.speed_rad_per_s
        if share.max() > SPEED_SLACK:
            _, joint = np.unravel_index(int(np.argmax(share)), share.shape)
            raise DeviceError(
                f"joint {joint + 1} would move at {np.rad2deg(speeds[:, joint].max()):.0f}°/s, "
                f"{np.rad2deg(self.model.speed_rad_per_s[joint]):.0f}°/s are allowed",
                joint=int(joint) + 1,
            )

    def _refuse_limits(self, qs: Floats) -> None:
        """Raise DeviceError where a joint limit would be exceeded."""
        room = self.model.limits.clearance_rad(qs)
        if room.min() < -ROUNDING_RAD:
            sample, joint = np.unravel_index(int(np.argmin(room)), room.shape)
            raise DeviceError(
                f"joint {joint + 1} would go to {np.rad2deg(qs[sample, joint]):.1f}°, beyond its "
                f"limit",
                joint=int(joint) + 1,
            )


def _standing(q_rad: Floats) -> _Course:
    return _Course(np.zeros(1), np.array(q_rad, dtype=np.float64)[None], stopped_s=0.0)
