"""Virtual optical tracker: true markers, measured with errors, fitted to known tools."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from rona_core.devices.marker_geometry import GEOMETRIES, MarkerGeometry
from rona_core.devices.protocols import Clock
from rona_core.devices.samples import ToolSample, TrackerFrame
from rona_core.devices.settings import TOOLS, TrackerSettings
from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.virtual.noise import rng
from rona_core.virtual.tracker.faults import NO_DRIFT, drift_mm, dropped, swapped_markers
from rona_core.virtual.tracker.marker_error import in_volume, marker_error
from rona_core.virtual.tracker.reporting_rules import ToolReport, report_tool

FACING_LIMIT_RAD = np.deg2rad(60.0)  # flat markers are lost beyond this angle to the line of sight
HYSTERESIS_RAD = np.deg2rad(2.0)  # and found again this much earlier
MEMORY_S = 1.0  # how far back the tracker remembers which markers it followed
SAME_TIME_S = 1e-9  # rounding of frame times

TruePose = Callable[[str, float], Pose | None]  # tool, time in seconds -> T_tracker_marker
Clear = Callable[[str, Pose, float], Bools]  # tool, true pose, time -> markers (m,) not hidden


@dataclass(frozen=True, slots=True, eq=False)
class ViewConditions:
    """What stands between a tool and a perfect measurement in one frame."""

    facing: Bools | None = None  # markers (m,) that look at the cameras; None: by their angle
    clear: Bools | None = None  # markers (m,) that both cameras see; None: all
    drift: Floats = field(default_factory=lambda: NO_DRIFT)  # (3,) mm, of a tracker not yet warm
    swapped: Sequence[int] | None = None  # two markers taken for each other: a ghost solution


UNDISTURBED = ViewConditions()


def observe(
    geometry: MarkerGeometry,
    T_tracker_marker: Pose,
    white: Floats,
    settings: TrackerSettings,
    seed: int,
    conditions: ViewConditions = UNDISTURBED,
) -> ToolReport:
    """Return what a tracker measures of a tool that really is at ``T_tracker_marker``.

    Args:
        geometry: Markers of the tool.
        T_tracker_marker: True pose.
        white: Standard normal numbers (m, 3), one row per marker.
        settings: Profile and ratio of the errors.
        seed: Seed of the session, which fixes the bias field of this tracker.
        conditions: Occlusion, drift and ghost solutions of the frame.
    """
    points = T_tracker_marker @ geometry.positions_marker
    facing, clear = conditions.facing, conditions.clear
    if facing is None:
        cosines = sight_cosines(geometry, T_tracker_marker)
        facing = np.asarray(cosines >= np.cos(FACING_LIMIT_RAD))
    measured = marker_error(settings, seed).measure(points, white) + conditions.drift
    return report_tool(
        geometry,
        measured,
        facing=facing,
        inside=in_volume(points, settings.profile),
        clear=np.ones(len(points), dtype=np.bool_) if clear is None else clear,
        swapped=conditions.swapped,
    )


def sample_tool(
    tool: str,
    T_tracker_marker: Pose | None,
    white: Floats,
    settings: TrackerSettings,
    seed: int,
    conditions: Callable[[MarkerGeometry, Pose], ViewConditions],
) -> ToolSample:
    """Return what a frame holds of a tool at its true pose; None: it is not before the tracker."""
    if tool in settings.hidden_tools:
        return ToolSample(tool, "covered")
    if T_tracker_marker is None:
        return ToolSample(tool, "out_of_view")
    geometry = GEOMETRIES[tool]
    seen = observe(
        geometry, T_tracker_marker, white, settings, seed, conditions(geometry, T_tracker_marker)
    )
    if seen.fit is None:
        return ToolSample(tool, seen.status)
    return ToolSample(tool, seen.status, seen.fit.T_tracker_marker, seen.fit.rms_error_mm)


def sight_cosines(geometry: MarkerGeometry, T_tracker_marker: Pose) -> Floats:
    """Return the cosines (m,) of the angles between marker normals and lines of sight.

    Markers without a normal are spheres that are seen from every side.
    """
    points = T_tracker_marker @ geometry.positions_marker
    if not geometry.facing_marker.any():
        return np.ones(len(points))
    facing = T_tracker_marker.rotate(geometry.facing_marker)
    sight = -points / np.linalg.norm(points, axis=1)[:, None]
    return np.asarray(sight @ facing)


def white_numbers(seed: int, ordinal: int, number: int) -> dict[str, Floats]:
    """Return the standard normal numbers (m, 3) of each tool's markers in one frame."""
    generator = rng(seed, "tracker", ordinal, number)
    return {
        tool: generator.standard_normal(GEOMETRIES[tool].positions_marker.shape) for tool in TOOLS
    }


class VirtualTracker:
    """A tracker that looks at true poses; satisfies ``devices.Tracker``.

    Frame k arrives at k / rate seconds of the capture, and was measured earlier by the latency. It
    depends on the seed, the capture's ordinal and k only, so that neither polling nor the pace of
    the clock changes what is measured.
    """

    def __init__(
        self, clock: Clock, true_pose: TruePose, seed: int, clear: Clear | None = None
    ) -> None:
        """Look at ``true_pose(tool, time_s)``, None for a tool that is not there.

        Without ``clear`` nothing ever stands before a marker.
        """
        self._clock = clock
        self._true_pose = true_pose
        self._clear = clear
        self._seed = seed
        self._settings = TrackerSettings()
        self._ordinal = 0
        self._closed = False

    def begin(self, settings: TrackerSettings, ordinal: int) -> None:
        """Measure like this from now on, for capture number ``ordinal``."""
        self._settings, self._ordinal = settings, ordinal

    def latest(self) -> TrackerFrame:
        """Return the newest frame; the clock does not move.

        Raises:
            DeviceError: the tracker has been closed.
        """
        number = int((self._clock.now() + SAME_TIME_S) * self._settings.rate_hz)
        while self._dropped(number):
            number -= 1
        return self.frame(number)

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
            raise DeviceError("the tracker has been closed: open the session again to use it")
        white = white_numbers(self._seed, self._ordinal, number)
        tools = tuple(self._sample(tool, number, white[tool]) for tool in TOOLS)
        return TrackerFrame(number, number / self._settings.rate_hz, tools)

    def close(self) -> None:
        """Release the tracker; a second call does nothing."""
        self._closed = True

    def _dropped(self, number: int) -> bool:
        return dropped(self._settings, self._seed, self._ordinal, number)

    def _measured_s(self, number: int) -> float:
        return number / self._settings.rate_hz - self._settings.latency_s

    def _sample(self, tool: str, number: int, white: Floats) -> ToolSample:
        settings, time_s = self._settings, self._measured_s(number)
        visible = self._clear if settings.occlusion else None

        def conditions(geometry: MarkerGeometry, pose: Pose) -> ViewConditions:
            return ViewConditions(
                self._facing(geometry, pose, number),
                None if visible is None else visible(tool, pose, time_s),
                drift_mm(settings, self._seed, self._ordinal, number / settings.rate_hz),
                swapped_markers(settings, geometry, self._seed, self._ordinal, number),
            )

        covered = tool in settings.hidden_tools
        pose = None if covered else self._true_pose(tool, time_s)
        return sample_tool(tool, pose, white, settings, self._seed, conditions)

    def _facing(self, geometry: MarkerGeometry, pose: Pose, number: int) -> Bools:
        """Return which markers (m,) are followed, with hysteresis.

        Between the angles at which one is found and lost, what it did last decides; with no past
        it is followed.
        """
        lost, found = np.cos(FACING_LIMIT_RAD), np.cos(FACING_LIMIT_RAD - HYSTERESIS_RAD)
        cosines = sight_cosines(geometry, pose)
        facing, open_ = cosines >= lost, (cosines >= lost) & (cosines < found)
        first = max(0, number - int(MEMORY_S * self._settings.rate_hz))
        for earlier in range(number - 1, first - 1, -1):
            if not open_.any():
                break
            past = self._true_pose(geometry.tool, self._measured_s(earlier))
            before = None if past is None else sight_cosines(geometry, past)
            if before is None:
                facing = facing & ~open_
                break
            facing = facing & ~(open_ & (before < lost))
            open_ = open_ & (before >= lost) & (before < found)
        return facing
