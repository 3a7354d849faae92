"""Virtual optical tracker: true markers, measured with errors, fitted to known tools.

Frames are measured in blocks wherever the motion is laid out beforehand. A block begins at a
multiple of its length, independent of which frame is read and when, so that the pace of a capture
changes no bit of what is measured.
"""

from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rona_core.devices.protocols import Clock
from rona_core.devices.samples import LateSamples, ToolColumn, TrackerFrame
from rona_core.devices.settings import TOOLS, TrackerSettings
from rona_core.devices.trackers import GEOMETRIES, MarkerGeometry
from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Poses
from rona_core.virtual.noise import standard_normals
from rona_core.virtual.tracker.faults import drift_mm, dropped, swapped_markers
from rona_core.virtual.tracker.marker_error import in_volume, marker_error
from rona_core.virtual.tracker.occlusion import Sight
from rona_core.virtual.tracker.reporting_rules import report_tool


class LateColumn:
    """The samples of one tool in n frames, computed once, on first access."""

    __slots__ = ("_column", "_compute")

    def __init__(self, compute: Callable[[], ToolColumn]) -> None:
        """Take what gives them (n,); it depends on nothing that may change."""
        self._compute = compute
        self._column: ToolColumn | None = None

    def __call__(self) -> ToolColumn:
        """Return them."""
        column = self._column  # two threads may work it out at once, none waits
        if column is None:
            column = self._column = self._compute()
            self._compute = lambda: column  # what they were made of is let go
        return column


FACING_LIMIT_RAD = np.deg2rad(60.0)  # flat markers are lost beyond this angle to the line of sight
HYSTERESIS_RAD = np.deg2rad(2.0)  # and found again this much earlier
MEMORY_S = 1.0  # how far back the tracker remembers which markers it followed
SAME_TIME_S = 1e-9  # rounding of frame times
BLOCK = 256  # frames that are measured at once
CLOSED = "the tracker has been closed: open the session again to use it"


class TrackedWorld(Protocol):
    """What a virtual tracker looks at."""

    def Ts_tracker_marker(  # noqa: N802 (frame grammar)
        self, tool: str, times_s: Floats
    ) -> Poses | None:
        """Return the true poses (n,) of a tool at times (n,), None if it is not there."""
        ...

    def sight(self, times_s: Floats) -> Sight:
        """Return the visibility of markers at times (n,), whatever happens later."""
        ...

    def motion_key(self) -> Hashable | None:
        """Return what decides all poses to come, None while they answer to what happens."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ViewConditions:
    """What stands between a tool and a perfect measurement in n frames."""

    facing: Bools | None = None  # markers (n, m) that look at the cameras; None: by their angle
    clear: Bools | None = None  # markers (n, m) that both cameras see; None: all
    drift: Floats | None = None  # (n, 3) mm, of a tracker not yet warm; None: it is
    swapped: Ints | None = None  # (n, 2) markers taken for each other, -1 where none are
    share: float = 1.0  # of the error that the maker states


UNDISTURBED = ViewConditions()


def observe(
    geometry: MarkerGeometry,
    Ts_tracker_marker: Poses,
    white: Floats,
    settings: TrackerSettings,
    seed: int,
    conditions: ViewConditions = UNDISTURBED,
) -> ToolColumn:
    """Return what a tracker measures in n frames of a tool that really is at ``Ts_tracker_marker``.

    Args:
        geometry: Markers of the tool.
        Ts_tracker_marker: True poses (n,).
        white: Standard normal numbers (n, m, 3), one row per marker.
        settings: Profile and ratio of the errors.
        seed: Seed of the session, which fixes the bias field of this tracker.
        conditions: Occlusion, drift and ghost solutions of the frames.
    """
    points = Ts_tracker_marker.map_points(geometry.positions_marker)
    facing, clear = conditions.facing, conditions.clear
    if facing is None:
        facing = sight_cosines(geometry, Ts_tracker_marker) >= np.cos(FACING_LIMIT_RAD)
    measured = marker_error(settings, seed).measure(points, white, conditions.share)
    if conditions.drift is not None:
        measured = measured + conditions.drift[:, None]
    return report_tool(
        geometry,
        measured,
        facing=np.asarray(facing),
        inside=in_volume(points.reshape(-1, 3), settings.profile).reshape(points.shape[:2]),
        clear=np.ones(points.shape[:2], dtype=np.bool_) if clear is None else clear,
        swapped=conditions.swapped,
    )


def sight_cosines(geometry: MarkerGeometry, Ts_tracker_marker: Poses) -> Floats:
    """Return the cosines (n, m) of the angles between marker normals and lines of sight.

    Markers without a normal are spheres that are seen from every side.
    """
    points = Ts_tracker_marker.map_points(geometry.positions_marker)
    if not geometry.facing_marker.any():
        return np.ones(points.shape[:2])
    normals = Ts_tracker_marker.rotations @ geometry.facing_marker
    across = -np.einsum("nmi,ni->nm", points, normals)
    return across / np.linalg.norm(points, axis=2)


def white_numbers(seed: int, device: str, ordinal: int, numbers: Ints) -> dict[str, Floats]:
    """Return the standard normal numbers (n, m, 3) of each tool's markers in some frames (n,)."""
    counts = [GEOMETRIES[tool].positions_marker.size for tool in TOOLS]
    drawn = standard_normals((seed, device, ordinal), numbers, sum(counts))
    columns = np.split(drawn, np.cumsum(counts)[:-1], axis=1)
    return {
        tool: column.reshape(len(numbers), -1, 3)
        for tool, column in zip(TOOLS, columns, strict=True)
    }


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """Frames from number ``first`` on, as long as the motion is the one they were seen on."""

    first: int
    motion: Hashable | None
    frames: tuple[TrackerFrame, ...]


class VirtualTracker:
    """A tracker that looks at true poses; satisfies ``devices.Tracker``.

    Frame k arrives at k / rate seconds of the capture, and was measured earlier by the latency. It
    depends on the seed, the capture's ordinal and k only, so that neither polling nor the pace of
    the clock changes what is measured.
    """

    def __init__(self, clock: Clock, world: TrackedWorld, seed: int, share: float = 1.0) -> None:
        """Look at a world; its error is ``share`` of what its maker states."""
        self._clock, self._share = clock, share
        self._world = world
        self._seed = seed
        self._settings = TrackerSettings()
        self._ordinal = 0
        self._closed = False
        self._block = _Block(0, None, ())

    def begin(self, settings: TrackerSettings, ordinal: int) -> None:
        """Measure like this from now on, for capture number ``ordinal``."""
        self._settings, self._ordinal = settings, ordinal
        self._block = _Block(0, None, ())

    def latest(self) -> TrackerFrame:
        """Return the newest frame; the clock does not move.

        Raises:
            DeviceError: the tracker has been closed.
        """
        number = int((self._clock.now() + SAME_TIME_S) * self._settings.rate_hz)
        while self._dropped(number):
            number -= 1
        return self.frame(number)

    def past(self, since_s: float, rate_hz: float) -> list[TrackerFrame]:
        """Return frames that came since a time of this capture, about ``rate_hz`` a second.

        Raises:
            DeviceError: the tracker has been closed.
        """
        if self._closed:
            raise DeviceError(CLOSED)
        own_hz = self._settings.rate_hz
        first = int(np.ceil((since_s - SAME_TIME_S) * own_hz))
        end = int((self._clock.now() + SAME_TIME_S) * own_hz) + 1
        numbers = np.arange(first, end, max(1, round(own_hz / rate_hz)))
        came = [not self._dropped(number) for number in numbers.tolist()]
        return list(self._measure(numbers[np.array(came, dtype=np.bool_)]))

    def frames(self) -> Iterator[TrackerFrame]:
        """Yield frames one after the other, waiting for each; ends when the tracker is closed."""
        rate_hz = self._settings.rate_hz
        number = int(np.ceil((self._clock.now() - SAME_TIME_S) * rate_hz))
        while not self._closed:
            self._clock.wait_until(number / rate_hz)
            if self._closed:
                return
            if not self._dropped(number):
                yield self.frame(number)
            number = max(number + 1, int((self._clock.now() + SAME_TIME_S) * rate_hz))

    def frame(self, number: int) -> TrackerFrame:
        """Return frame ``number`` of this capture.

        Raises:
            DeviceError: the tracker has been closed.
        """
        if self._closed:
            raise DeviceError(CLOSED)
        motion, block = self._world.motion_key(), self._block
        if motion is None:
            return self._measure(np.array([number]))[0]
        first = number - number % BLOCK
        if not block.frames or (block.first, block.motion) != (first, motion):
            block = self._block = _Block(first, motion, self._measure(first + np.arange(BLOCK)))
        return block.frames[number - first]

    def close(self) -> None:
        """Release the tracker; a second call does nothing."""
        self._closed = True

    def _dropped(self, number: int) -> bool:
        return dropped(self._settings, self._seed, self._ordinal, number)

    def _measure(self, numbers: Ints) -> tuple[TrackerFrame, ...]:
        """Return the frames of these numbers (n,), which grow."""
        if not len(numbers):
            return ()
        white = white_numbers(self._seed, "tracker", self._ordinal, numbers)
        sight = self._world.sight(self._measured_s(numbers)) if self._settings.occlusion else None
        columns = {
            tool: LateColumn(self._samples(tool, numbers, white[tool], sight)) for tool in TOOLS
        }
        return tuple(
            TrackerFrame(number, number / self._settings.rate_hz, LateSamples(columns, row))
            for row, number in enumerate(numbers.tolist())
        )

    def _samples(
        self, tool: str, numbers: Ints, white: Floats, sight: Sight | None
    ) -> Callable[[], ToolColumn]:
        """Return what gives the samples of a tool; poses are those of now, the rest can wait."""
        settings, seed, ordinal, share = self._settings, self._seed, self._ordinal, self._share
        if tool in settings.hidden_tools:
            return lambda: ToolColumn.unseen(tool, "covered", len(numbers))
        Ts = self._world.Ts_tracker_marker(tool, self._measured_s(numbers))
        if Ts is None:
            return lambda: ToolColumn.unseen(tool, "out_of_view", len(numbers))
        geometry = GEOMETRIES[tool]
        facing = self._facing(geometry, Ts, numbers)

        def measured() -> ToolColumn:
            conditions = ViewConditions(
                facing,
                None if sight is None else sight(tool, Ts),
                drift_mm(settings, seed, ordinal, numbers / settings.rate_hz),
                swapped_markers(settings, geometry, seed, ordinal, numbers),
                share,
            )
            return observe(geometry, Ts, white, settings, seed, conditions)

        return measured

    def _measured_s(self, numbers: Ints) -> Floats:
        return numbers / self._settings.rate_hz - self._settings.latency_s

    def _facing(self, geometry: MarkerGeometry, Ts_tracker_marker: Poses, numbers: Ints) -> Bools:
        """Return which markers (n, m) are followed in the frames of these numbers (n,).

        Between the angles at which one is found and lost, what it did last decides; with no past
        within the tracker's memory it is followed.
        """
        lost, found = np.cos(FACING_LIMIT_RAD), np.cos(FACING_LIMIT_RAD - HYSTERESIS_RAD)
        cosines = sight_cosines(geometry, Ts_tracker_marker)
        if not ((cosines >= lost) & (cosines < found)).any():
            return np.asarray(cosines >= lost)
        memory, first = int(MEMORY_S * self._settings.rate_hz), int(numbers[0])
        # what happened before and between them decides too
        dense = np.arange(max(0, first - memory), int(numbers[-1]) + 1)
        others = np.setdiff1d(dense, numbers)
        past = None
        if len(others):
            past = self._world.Ts_tracker_marker(geometry.tool, self._measured_s(others))
        wanted = np.arange(len(numbers))
        if past is not None:
            wanted, seen = numbers - dense[0], cosines
            cosines = np.zeros((len(dense), seen.shape[1]))
            cosines[others - dense[0]], cosines[wanted] = sight_cosines(geometry, past), seen
        rows = np.arange(len(cosines))[:, None]
        decided = np.where((cosines < lost) | (cosines >= found), rows, -1)
        last = np.maximum.accumulate(decided, axis=0)
        followed = np.take_along_axis(cosines >= found, np.maximum(last, 0), axis=0)
        forgotten = (last < 0) | (rows - last > memory)
        return np.asarray((followed | forgotten)[wanted])
