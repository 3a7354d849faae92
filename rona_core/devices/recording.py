"""Recorded tracker stream by column: pose and status of each tool in every frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rona_core.devices.protocols import Clock, Origin
from rona_core.devices.samples import WITH_POSE, ToolSample, ToolStatus, ToolTrack, TrackerFrame
from rona_core.errors import DeviceError, InvalidInputError, NotFoundError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Poses


@dataclass(frozen=True, slots=True, eq=False)
class RecordedTool:
    """One tool over the n frames of a recording."""

    tool: str
    statuses: tuple[ToolStatus, ...]  # (n,) it has a pose where this is in WITH_POSE
    Ts_tracker_marker: Poses  # of those frames, in order
    rms_error_mm: Floats  # (n,) of the fit of the markers; 0 where it is not known
    rms_known: Bools  # (n,)
    rows: Ints = field(init=False, repr=False)  # (n,) which pose is that of a frame; -1 for none

    def __post_init__(self) -> None:
        seen = np.array([status in WITH_POSE for status in self.statuses], dtype=np.bool_)
        if int(seen.sum()) != len(self.Ts_tracker_marker):
            raise InvalidInputError(
                f"{self.tool} is seen in {int(seen.sum())} frames, but has "
                f"{len(self.Ts_tracker_marker)} poses"
            )
        rows = np.where(seen, np.cumsum(seen) - 1, -1)
        object.__setattr__(self, "rows", readonly(rows.astype(np.int64)))

    def seen(self) -> Bools:
        """Return in which frames (n,) the tool has a pose."""
        return self.rows >= 0


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Frames of a tracker in their order.

    ``n_frames`` counts the frames of the capture; it exceeds the frames held here where those
    without any tool were not kept.
    """

    numbers: Ints  # (n,) only growing
    times_s: Floats  # (n,) only growing
    tools: tuple[RecordedTool, ...]
    n_frames: int

    def __post_init__(self) -> None:
        n = len(self.numbers)
        if not n or len(self.times_s) != n or any(len(t.statuses) != n for t in self.tools):
            raise InvalidInputError(
                f"a recording needs a number, a time and each tool for every frame: {n} numbers, "
                f"{len(self.times_s)} times, {[len(t.statuses) for t in self.tools]} of the tools"
            )
        if self.n_frames < n:
            raise InvalidInputError(f"{n} frames are held, so there cannot be {self.n_frames}")
        for what, values in (("number", self.numbers), ("time", self.times_s)):
            back = np.flatnonzero(np.diff(values) <= 0)
            if len(back):
                i = int(back[0])
                raise InvalidInputError(
                    f"the {what} of frame {i + 1} (from 0) must be above {values[i]:.9g}, that of "
                    f"the frame before, not {values[i + 1]:.9g}"
                )
        object.__setattr__(self, "numbers", readonly(self.numbers))
        object.__setattr__(self, "times_s", readonly(self.times_s))

    @classmethod
    def from_frames(cls, frames: Sequence[TrackerFrame]) -> "Recording":
        """Collect the frames of a stream.

        Raises:
            InvalidInputError: no frames; tools that differ from frame to frame; a status that
                does not fit the pose; numbers or times that do not grow.
        """
        if not frames:
            raise InvalidInputError("a recording needs at least one frame")
        names = [sample.tool for sample in frames[0].tools]
        for frame in frames:
            tools = [sample.tool for sample in frame.tools]
            if tools != names:
                raise InvalidInputError(
                    f"frame {frame.number} has {', '.join(tools) or 'no tools'}, "
                    f"the first one of {', '.join(names) or 'no tools'}"
                )
        columns = [_column([frame.tools[k] for frame in frames]) for k in range(len(names))]
        return cls(
            numbers=np.array([frame.number for frame in frames], dtype=np.int64),
            times_s=np.array([frame.time_s for frame in frames], dtype=np.float64),
            tools=tuple(columns),
            n_frames=len(frames),
        )

    @classmethod
    def from_track(cls, track: ToolTrack) -> "Recording":
        """Return what a stored capture of one tool holds: the frames in which it was seen.

        Raises:
            InvalidInputError: the tool was seen in no frame.
        """
        n = len(track.times_s)
        if not n:
            raise InvalidInputError(f"{track.tool} was seen in no frame of this capture")
        known = np.ones(n, dtype=np.bool_)
        statuses: tuple[ToolStatus, ...] = ("ok",) * n
        column = RecordedTool(
            track.tool, statuses, track.Ts_tracker_marker, track.rms_error_mm, readonly(known)
        )
        return cls(track.frame_numbers, track.times_s, (column,), track.n_frames)

    def __len__(self) -> int:
        return len(self.numbers)

    def tool(self, name: str) -> RecordedTool:
        """Return what was seen of one tool.

        Raises:
            NotFoundError: the recording does not know it.
        """
        for column in self.tools:
            if column.tool == name:
                return column
        known = ", ".join(column.tool for column in self.tools) or "none"
        raise NotFoundError(f"there is no tool {name!r} in the recording; its tools are {known}")

    def only(self, name: str) -> "Recording":
        """Return the same frames with one tool alone; errors as in ``tool``."""
        return replace(self, tools=(self.tool(name),))

    def from_zero(self) -> "Recording":
        """Return the same frames with times that start at 0."""
        return replace(self, times_s=self.times_s - self.times_s[0])

    def frame(self, index: int) -> TrackerFrame:
        """Return frame ``index``, counted from 0."""
        samples = tuple(_sample(column, index) for column in self.tools)
        return TrackerFrame(int(self.numbers[index]), float(self.times_s[index]), samples)

    def frames(self) -> Iterator[TrackerFrame]:
        """Yield all frames in order."""
        return (self.frame(i) for i in range(len(self)))

    def track(self, name: str) -> ToolTrack:
        """Return one tool as a capture stores it; errors as in ``tool``."""
        column = self.tool(name)
        seen = column.seen()
        return ToolTrack(
            tool=name,
            frame_numbers=readonly(self.numbers[seen]),
            times_s=readonly(self.times_s[seen]),
            Ts_tracker_marker=column.Ts_tracker_marker,
            rms_error_mm=readonly(column.rms_error_mm[seen]),
            n_frames=self.n_frames,
        )


def _column(samples: Sequence[ToolSample]) -> RecordedTool:
    for i, sample in enumerate(samples):
        if (sample.T_tracker_marker is None) == (sample.status == "ok"):
            has = "no pose" if sample.T_tracker_marker is None else "a pose"
            raise InvalidInputError(
                f"{sample.tool} has the status {sample.status!r} and {has} in frame {i} (from 0)"
            )
    poses = [s.T_tracker_marker for s in samples if s.T_tracker_marker is not None]
    errors = [0.0 if s.rms_error_mm is None else s.rms_error_mm for s in samples]
    return RecordedTool(
        tool=samples[0].tool,
        statuses=tuple(sample.status for sample in samples),
        Ts_tracker_marker=Poses.stack(poses),
        rms_error_mm=readonly(np.array(errors, dtype=np.float64)),
        rms_known=readonly(np.array([s.rms_error_mm is not None for s in samples], dtype=np.bool_)),
    )


def _sample(column: RecordedTool, index: int) -> ToolSample:
    status = column.statuses[index]
    rms_error_mm = float(column.rms_error_mm[index]) if column.rms_known[index] else None
    row = int(column.rows[index])
    pose = column.Ts_tracker_marker[row] if row >= 0 else None
    return ToolSample(column.tool, status, pose, rms_error_mm)


SAME_TIME_S = 1e-9  # rounding of frame times
CLOSED = "the replay has been closed: import the recording again"


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
            raise DeviceError(CLOSED)
        passed = np.searchsorted(self._recording.times_s, self._now(), side="right")
        return self._recording.frame(max(int(passed) - 1, 0))

    def past(self, since_s: float, rate_hz: float) -> list[TrackerFrame]:
        """Return frames that came since a time of the clock, about ``rate_hz`` a second.

        Raises:
            DeviceError: the tracker has been closed.
        """
        if self._closed:
            raise DeviceError(CLOSED)
        times = self._recording.times_s
        came = np.flatnonzero((times >= since_s - SAME_TIME_S) & (times <= self._now()))
        slots = ((times[came] - since_s) * rate_hz + SAME_TIME_S).astype(np.int64)
        return [self._recording.frame(int(came[i])) for i in np.unique(slots, return_index=True)[1]]

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
