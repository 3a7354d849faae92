"""Device samples, tracks of them by column, and poses between two samples.

Device samples, and tracks of samples by column for a whole capture. All times are seconds on the
clock of the capture, which starts at 0.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal, overload

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

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


@dataclass(frozen=True, slots=True, eq=False)
class ToolColumn:
    """One tool in n tracker frames: a column of the table of samples."""

    tool: str
    statuses: Sequence[ToolStatus]  # (n,)
    seen: Bools  # (n,) there is a pose
    Ts_tracker_marker: Poses  # n poses, the identity where there is none
    rms_error_mm: Floats  # (n,) fit of the markers; 0 where there is none

    @classmethod
    def of_one(cls, sample: ToolSample) -> "ToolColumn":
        """Return the column of a single frame; an RMS error that is not known counts as 0."""
        pose = sample.T_tracker_marker
        return cls(
            sample.tool,
            (sample.status,),
            np.array([pose is not None]),
            Poses.stack([Pose.identity() if pose is None else pose]),
            np.array([sample.rms_error_mm or 0.0]),
        )

    @classmethod
    def unseen(cls, tool: str, status: ToolStatus, n: int) -> "ToolColumn":
        """Return the column of a tool that has no pose in any of n frames."""
        eyes, zeros = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
        poses = Poses.unchecked(eyes, zeros)
        return cls(tool, (status,) * n, np.zeros(n, dtype=np.bool_), poses, np.zeros(n))

    def __len__(self) -> int:
        return len(self.statuses)

    def __getitem__(self, row: int) -> ToolSample:
        if not self.seen[row]:
            return ToolSample(self.tool, self.statuses[row])
        pose, rms_mm = self.Ts_tracker_marker[row], float(self.rms_error_mm[row])
        return ToolSample(self.tool, self.statuses[row], pose, rms_mm)


class LateSamples(Sequence[ToolSample]):
    """The samples of all tools in one of many frames, each computed on access."""

    __slots__ = ("_columns", "row")

    def __init__(self, columns: Mapping[str, Callable[[], ToolColumn]], row: int) -> None:
        """Take frame number ``row`` of what the column of each tool gives."""
        self._columns, self.row = columns, row

    def column(self, name: str) -> ToolColumn | None:
        """Return the samples of one tool in all of the frames, or None if there is none."""
        column = self._columns.get(name)
        return None if column is None else column()

    def __len__(self) -> int:
        return len(self._columns)

    @overload
    def __getitem__(self, index: int) -> ToolSample: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[ToolSample, ...]: ...
    def __getitem__(self, index: int | slice) -> ToolSample | tuple[ToolSample, ...]:
        columns = list(self._columns.values())[index]
        if isinstance(columns, list):
            return tuple(column()[self.row] for column in columns)
        return columns()[self.row]


@dataclass(frozen=True, slots=True, eq=False)
class TrackerFrame:
    """One frame of the tracker. Order frames by ``number``, not by the host clock."""

    number: int
    time_s: float
    tools: Sequence[ToolSample]

    def tool(self, name: str) -> ToolSample | None:
        """Return the sample of one tool, or None if the tracker does not know it."""
        if isinstance(self.tools, LateSamples):
            column = self.tools.column(name)
            return None if column is None else column[self.tools.row]
        return next((sample for sample in self.tools if sample.tool == name), None)

    def column(self, name: str) -> tuple[ToolColumn | None, int]:
        """Return the column in which a tool stands, None if there is none, and the row."""
        if isinstance(self.tools, LateSamples):
            return self.tools.column(name), self.tools.row
        sample = self.tool(name)
        return None if sample is None else ToolColumn.of_one(sample), 0


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
        kept: list[TrackerFrame] = []
        poses, rms_mm = [Poses.stack([])], [np.zeros(0)]
        placed = [(frame, *frame.column(tool)) for frame in frames]
        for column, of_column in groupby(placed, key=lambda one: one[1]):
            if column is None:
                continue
            seen = [(frame, row) for frame, _, row in of_column if column.seen[row]]
            rows = np.array([row for _, row in seen], dtype=np.int64)
            kept += [frame for frame, _ in seen]
            poses.append(column.Ts_tracker_marker.select(rows))
            rms_mm.append(column.rms_error_mm[rows])
        return cls(
            tool=tool,
            frame_numbers=readonly(np.array([f.number for f in kept], dtype=np.int64)),
            times_s=readonly(np.array([f.time_s for f in kept], dtype=np.float64)),
            Ts_tracker_marker=Poses.joined(poses),
            rms_error_mm=readonly(np.concatenate(rms_mm)),
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

    def part(self, which: Bools) -> "AScanTrack":
        """Return some of the A-scans (n,)."""
        return replace(
            self, times_s=self.times_s[which], rf=self.rf[which], clipped=self.clipped[which]
        )

    def __len__(self) -> int:
        return len(self.times_s)


NEAR_S = 0.05  # an instant counts only if the tool was seen this shortly before and after it


@dataclass(frozen=True, slots=True, eq=False)
class InterpolatedPoses:
    """Poses of a tool at those of n instants at which it is known."""

    known: Bools  # (n,)
    Ts_tracker_marker: Poses  # one for each known instant


def interpolate_poses(
    track: ToolTrack, times_s: Floats, *, delay_s: float = 0.0
) -> InterpolatedPoses:
    """Return where a tool was at some instants.

    Between two frames the position runs straight and the rotation by the shortest way, evenly.

    Args:
        track: What the tracker delivered.
        times_s: Instants (n,), by the clock of the capture.
        delay_s: By how much later than it was measured each frame arrived.
    """
    measured_s, wanted = track.times_s - delay_s, np.asarray(times_s, dtype=np.float64)
    if len(measured_s) < 2:
        none = Poses(np.zeros((0, 3, 3)), np.zeros((0, 3)))
        return InterpolatedPoses(readonly(np.zeros(len(wanted), dtype=np.bool_)), none)
    after = np.clip(np.searchsorted(measured_s, wanted), 1, len(measured_s) - 1)
    before = after - 1
    slack = 1e-9
    known = (wanted >= measured_s[before] - slack) & (wanted <= measured_s[after] + slack)
    known &= (wanted - measured_s[before] <= NEAR_S) & (measured_s[after] - wanted <= NEAR_S)
    times = np.clip(wanted[known], measured_s[0], measured_s[-1])
    poses = track.Ts_tracker_marker
    turns = Slerp(measured_s, Rotation.from_matrix(poses.rotations))(times)
    places = np.stack([np.interp(times, measured_s, p) for p in poses.translations.T], axis=1)
    return InterpolatedPoses(readonly(known), Poses(turns.as_matrix().reshape(-1, 3, 3), places))
