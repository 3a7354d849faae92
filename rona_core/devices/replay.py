"""A tracker that plays a recording: its frames, at their times, on the clock of the capture."""

from collections.abc import Iterator

import numpy as np

from rona_core.devices.protocols import Clock, Origin
from rona_core.devices.recording import Recording
from rona_core.devices.samples import TrackerFrame
from rona_core.errors import DeviceError

SAME_TIME_S = 1e-9  # rounding of frame times


class ReplayTracker:
    """Satisfies ``devices.Tracker``; the first frame comes when the clock stands at 0.

    A recording ends: after its last frame ``frames`` ends too, and ``latest`` stays with it.
    """

    origin: Origin = "REPLAY"

    def __init__(self, recording: Recording, clock: Clock) -> None:
        """Play ``recording`` on ``clock``; its times are shifted so that they start at 0."""
        self._recording = recording.from_zero()
        self._clock = clock
        self._closed = False

    @property
    def duration_s(self) -> float:
        """Time of the last frame."""
        return float(self._recording.times_s[-1])

    def latest(self) -> TrackerFrame:
        """Return the newest frame; the clock does not move.

        Raises:
            DeviceError: the tracker has been closed.
        """
        if self._closed:
            raise DeviceError("the replay has been closed: import the recording again")
        passed = np.searchsorted(self._recording.times_s, self._now(), side="right")
        return self._recording.frame(max(int(passed) - 1, 0))

    def frames(self) -> Iterator[TrackerFrame]:
        """Yield the frames from now on, waiting for each; ends with the recording or on close."""
        first = int(np.searchsorted(self._recording.times_s, self._clock.now() - SAME_TIME_S))
        for i in range(first, len(self._recording)):
            if self._closed:
                return
            self._clock.wait_until(float(self._recording.times_s[i]))
            if self._closed:
                return
            yield self._recording.frame(i)

    def close(self) -> None:
        """Release the tracker; a second call does nothing."""
        self._closed = True

    def _now(self) -> float:
        return self._clock.now() + SAME_TIME_S
