"""Device samples, and tracks of samples by column for a whole capture.

All times are seconds on the clock of the capture, which starts at 0.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, overload

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Pose, Poses

ToolStatus = Literal[
    "ok",
    "partially_out_of_volume",  # some markers are outside; the pose comes from the others
    "out_of_volume",
    "out_of_view",  # not there, or turned away
    "missing",  # something stands before every marker
    "too_few_markers",
    "bad_fit",  # the markers do not fit the known geometry
    "low_spread",  # the markers that are left lie too close together, or in a line
    "covered",
]
WITH_POSE: tuple[ToolStatus, ...] = ("ok", "partially_out_of_volume")  # all others have none


@dataclass(frozen=True, slots=True, eq=False)
class ToolSample:
    """One tool in one tracker frame; ``T_tracker_marker`` is None while it is not seen."""

    tool: str
    status: ToolStatus
    T_tracker_marker: Pose | None = None
    rms_error_mm: float | None = None  # fit of the markers to the known geometry


class LateSamples(Sequence[ToolSample]):
    """The samples of all tools in one of many frames, each worked out when it is asked for."""

    __slots__ = ("_columns", "_row")

    def __init__(self, columns: Mapping[str, Callable[[], Sequence[ToolSample]]], row: int) -> None:
        """Take frame number ``row`` of what the column of each tool gives."""
        self._columns, self._row = columns, row

    def named(self, name: str) -> ToolSample | None:
        """Return the sample of one tool, or None if there is none of that name."""
        column = self._columns.get(name)
        return None if column is None else column()[self._row]

    def __len__(self) -> int:
        return len(self._columns)

    @overload
    def __getitem__(self, index: int) -> ToolSample: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[ToolSample, ...]: ...
    def __getitem__(self, index: int | slice) -> ToolSample | tuple[ToolSample, ...]:
        columns = list(self._columns.values())[index]
        if isinstance(columns, list):
            return tuple(column()[self._row] for column in columns)
        return columns()[self._row]


@dataclass(frozen=True, slots=True, eq=False)
class TrackerFrame:
    """One frame of the tracker. Order frames by ``number``, not by the host clock."""

    number: int
    time_s: float
    tools: Sequence[ToolSample]

    def tool(self, name: str) -> ToolSample | None:
        """Return the sample of one tool, or None if the tracker does not know it."""
        if isinstance(self.tools, LateSamples):
            return self.tools.named(name)
        return next((sample for sample in self.tools if sample.tool == name), None)


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """Joint angles (rad) as the robot's encoders report them."""

    time_s: float
    q_rad: Floats
    moving: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class AScan:
    """One received radio-frequency trace (samples,), in units of the converter's full scale."""

    time_s: float
    rf: Floats
    sampling_mhz: float
    start_us: float  # time of the first sample after the emission starts
    clipped: bool


@dataclass(frozen=True, slots=True, eq=False)
class ToolTrack:
    """One tool over a capture; frames in which it was not seen have no row."""

    tool: str
    frame_numbers: Ints  # (k,)
    times_s: Floats  # (k,)
    Ts_tracker_marker: Poses  # k poses
    rms_error_mm: Floats  # (k,)
    n_frames: int  # frames in the capture, seen or not

    @classmethod
    def from_frames(cls, tool: str, frames: Sequence[TrackerFrame]) -> "ToolTrack":
        """Collect one tool from the frames of a capture."""
        seen = [
            (frame, sample, sample.T_tracker_marker)
            for frame in frames
            if (sample := frame.tool(tool)) is not None and sample.T_tracker_marker is not None
        ]
        errors = [s.rms_error_mm or 0.0 for _, s, _ in seen]
        return cls(
            tool=tool,
            frame_numbers=readonly(np.array([f.number for f, _, _ in seen], dtype=np.int64)),
            times_s=readonly(np.array([f.time_s for f, _, _ in seen], dtype=np.float64)),
            Ts_tracker_marker=Poses.stack([pose for _, _, pose in seen]),
            rms_error_mm=readonly(np.array(errors, dtype=np.float64)),
            n_frames=len(frames),
        )


@dataclass(frozen=True, slots=True, eq=False)
class JointTrack:
    """Joint angles over a capture: times (n,), angles (n, 6) in radians."""

    times_s: Floats
    qs_rad: Floats

    @classmethod
    def from_samples(cls, samples: Sequence[JointSample]) -> "JointTrack":
        """Collect the samples of a capture."""
        return cls(
            readonly(np.array([s.time_s for s in samples], dtype=np.float64)),
            readonly(np.array([s.q_rad for s in samples], dtype=np.float64).reshape(-1, 6)),
        )

    def at(self, times_s: Floats) -> Floats:
        """Return the joint angles (m, 6) interpolated linearly to the given times (m,)."""
        columns = [np.interp(times_s, self.times_s, q) for q in self.qs_rad.T]
        return np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class AScanTrack:
    """A-scans over a capture: times (n,), traces (n, samples) as float32."""

    times_s: Floats
    rf: np.typing.NDArray[np.float32]
    sampling_mhz: float
    start_us: float
    clipped: Bools  # (n,)

    @classmethod
    def from_scans(cls, scans: Sequence[AScan]) -> "AScanTrack":
        """Collect the A-scans of a capture."""
        first = scans[0] if scans else AScan(0.0, np.zeros(0), 1.0, 0.0, False)
        return cls(
            times_s=readonly(np.array([s.time_s for s in scans], dtype=np.float64)),
            rf=readonly(
                # adding zero turns -0 into 0, so that equal samples have equal bits
                np.array([s.rf for s in scans], dtype=np.float32).reshape(len(scans), len(first.rf))
                + np.float32(0.0)
            ),
            sampling_mhz=first.sampling_mhz,
            start_us=first.start_us,
            clipped=readonly(np.array([s.clipped for s in scans], dtype=np.bool_)),
        )

    @classmethod
    def joined(cls, parts: "Sequence[AScanTrack]") -> "AScanTrack":
        """Return at least one track of one probe as one; of a single one that very track.

        Times stay as they are: each track has a clock of its own.

        Raises:
            InvalidInputError: they do not sample alike.
        """
        first = parts[0]
        if len(parts) == 1:
            return first
        if len({(part.sampling_mhz, part.start_us, part.rf.shape[1]) for part in parts}) > 1:
            raise InvalidInputError("A-scans that are sampled differently cannot be joined")
        return cls(
            times_s=readonly(np.concatenate([part.times_s for part in parts])),
            rf=readonly(np.concatenate([part.rf for part in parts])),
            sampling_mhz=first.sampling_mhz,
            start_us=first.start_us,
            clipped=readonly(np.concatenate([part.clipped for part in parts])),
        )

    def __len__(self) -> int:
        return len(self.times_s)
