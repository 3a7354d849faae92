"""Capture clock: jumps when waited on, or runs at a multiple of real time."""

import math
import threading
import time
from collections.abc import Callable

from rona_core.errors import InvalidInputError

MAX_LAG_S = 0.25  # a hiccup longer than this is forgiven instead of being caught up in a rush
LONGEST_PAUSE_S = 0.05  # how soon a wait notices a new speed, a reset or an interruption


class CaptureClock:
    """A clock in seconds that only :meth:`wait_until` moves; it satisfies ``devices.Clock``.

    With ``speed`` None a wait jumps to its end at once. With a number, the clock runs at that
    multiple of real time while a capture is awaited, so that it can be watched at 1x or 4x. What
    is measured depends on the time of the clock only, so the pace never changes a result.
    """

    def __init__(
        self, speed: float | None = None, *, wall: Callable[[], float] = time.monotonic
    ) -> None:
        """Start at 0; ``wall`` returns real time in seconds (another one in tests)."""
        self._lock = threading.Condition()
        self._wall = wall
        self._time_s = 0.0
        self._anchor = (0.0, 0.0)  # capture time and wall time that belong together
        self._generation = 0  # counts resets and interruptions: older waits give up
        self._speed = _as_speed(speed)
        self._sync()

    @property
    def speed(self) -> float | None:
        """Multiple of real time, or None for at once."""
        return self._speed

    @speed.setter
    def speed(self, speed: float | None) -> None:
        with self._lock:
            self._speed = _as_speed(speed)
            self._sync()
            self._lock.notify_all()

    def now(self) -> float:
        """Return the time since the capture began, in seconds."""
        return self._time_s  # one number, read in one go: no lock is needed

    def wait_until(self, time_s: float) -> None:
        """Move the clock to ``time_s``, at once or at its pace; a time gone by returns at once.

        :meth:`reset` and :meth:`interrupt` end the wait early, the clock then stays where it is.

        Raises:
            InvalidInputError: the time is not finite.
        """
        if not math.isfinite(time_s):
            raise InvalidInputError(f"time_s must be finite, not {time_s}")
        with self._lock:
            generation = self._generation
            while self._generation == generation and self._time_s < time_s:
                if self._speed is None:
                    self._time_s = float(time_s)
                    break
                remaining_s = self._run_to(time_s, self._speed)
                if remaining_s > 0.0:
                    self._lock.wait(min(remaining_s, LONGEST_PAUSE_S))

    def interrupt(self) -> None:
        """End all waits that are under way; later ones are not affected."""
        with self._lock:
            self._generation += 1
            self._lock.notify_all()

    def reset(self) -> None:
        """Go back to 0 for the next capture and end all waits of the last one."""
        with self._lock:
            self._time_s = 0.0
            self._generation += 1
            self._sync()
            self._lock.notify_all()

    def _run_to(self, time_s: float, speed: float) -> float:
        """Advance as far as real time allows; return the real seconds still to wait."""
        wall_s = self._wall()
        anchor_time_s, anchor_wall_s = self._anchor
        lag_s = wall_s - (anchor_wall_s + (self._time_s - anchor_time_s) / speed)
        if lag_s > MAX_LAG_S:  # nothing waited for a while: go on from here, do not rush
            self._sync()
            return (time_s - self._time_s) / speed
        due_s = anchor_time_s + (wall_s - anchor_wall_s) * speed
        self._time_s = min(float(time_s), max(self._time_s, due_s))
        return (time_s - self._time_s) / speed

    def _sync(self) -> None:
        self._anchor = (self._time_s, self._wall())


def _as_speed(speed: float | None) -> float | None:
    if speed is not None and not (math.isfinite(speed) and speed > 0.0):
        raise InvalidInputError(f"speed must be positive or None, not {speed}")
    return speed
