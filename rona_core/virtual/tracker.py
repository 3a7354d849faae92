"""The virtual optical tracker: true marker positions, seen with errors, fitted to known tools."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from rona_core.arrays import Floats
from rona_core.devices.markers import GEOMETRIES, MarkerGeometry
from rona_core.devices.protocols import Clock
from rona_core.devices.samples import ToolSample, ToolStatus, TrackerFrame
from rona_core.devices.settings import TOOLS, TrackerProfile, TrackerSettings
from rona_core.errors import DeviceError
from rona_core.geometry.pose import Pose
from rona_core.virtual.marker_fit import MarkerFit, fit_body, fit_line
from rona_core.virtual.noise import rng
from rona_core.virtual.tracker_error import in_volume, marker_error

FACING_LIMIT_RAD = np.deg2rad(60.0)  # flat markers are lost beyond this angle to the line of sight
MIN_MARKERS = {6: 3, 5: 2}  # by degrees of freedom of the tool
SAME_TIME_S = 1e-9  # rounding of frame times

TruePose = Callable[[str, float], Pose | None]  # tool, time in seconds -> T_tracker_marker


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What the tracker makes of one tool in one frame; ``fit`` is None while it is not seen."""

    status: ToolStatus
    fit: MarkerFit | None = None


def observe(
    geometry: MarkerGeometry,
    T_tracker_marker: Pose,
    white: Floats,
    profile: TrackerProfile,
    seed: int,
) -> Seen:
    """Return what a tracker measures of a tool that really is at ``T_tracker_marker``.

    Args:
        geometry: Markers of the tool.
        T_tracker_marker: True pose.
        white: Standard normal numbers (m, 3), one row per marker.
        profile: Error profile.
        seed: Seed of the session, which fixes the bias field of this tracker.
    """
    points = T_tracker_marker @ geometry.positions_marker
    if geometry.facing_marker.any():
        facing = T_tracker_marker.rotate(geometry.facing_marker)
        sight = -points / np.linalg.norm(points, axis=1)[:, None]
        faces = sight @ facing >= np.cos(FACING_LIMIT_RAD)
        if not faces.any():
            return Seen("out_of_view")
    else:
        faces = np.ones(len(points), dtype=np.bool_)
    inside = in_volume(points)
    if not inside.any():
        return Seen("out_of_volume")
    seen = faces & inside
    if np.count_nonzero(seen) < MIN_MARKERS[geometry.dof]:
        return Seen("too_few_markers")
    measured = marker_error(profile, seed).measure(points, white)
    fit = fit_body if geometry.dof == 6 else fit_line
    return Seen("ok", fit(geometry.positions_marker[seen], measured[seen]))


def white_numbers(seed: int, ordinal: int, number: int) -> dict[str, Floats]:
    """Return the standard normal numbers (m, 3) of each tool's markers in one frame."""
    generator = rng(seed, "tracker", ordinal, number)
    return {
        tool: generator.standard_normal(GEOMETRIES[tool].positions_marker.shape) for tool in TOOLS
    }


class VirtualTracker:
    """A tracker that looks at true poses; satisfies ``devices.Tracker``.

    Frame k is taken at k / rate seconds of the capture. It depends on the seed, the capture's
    ordinal and k only, so that neither polling nor the pace of the clock changes what is measured.
    """

    def __init__(self, clock: Clock, true_pose: TruePose, seed: int) -> None:
        """Look at ``true_pose(tool, time_s)``, None for a tool that is not there."""
        self._clock = clock
        self._true_pose = true_pose
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
        return self.frame(int((self._clock.now() + SAME_TIME_S) * self._settings.rate_hz))

    def frames(self) -> Iterator[TrackerFrame]:
        """Yield frames one after the other, waiting for each; ends when the tracker is closed."""
        rate_hz = self._settings.rate_hz
        number = int(np.ceil((self._clock.now() - SAME_TIME_S) * rate_hz))
        while not self._closed:
            self._clock.wait_until(number / rate_hz)
            if self._closed:
                return
            yield self.frame(number)
            number = max(number + 1, int((self._clock.now() + SAME_TIME_S) * rate_hz))

    def frame(self, number: int) -> TrackerFrame:
        """Return frame ``number`` of this capture.

        Raises:
            DeviceError: the tracker has been closed.
        """
        if self._closed:
            raise DeviceError("the tracker has been closed: open the session again to use it")
        time_s = number / self._settings.rate_hz
        white = white_numbers(self._seed, self._ordinal, number)
        tools = tuple(self._sample(tool, time_s, white[tool]) for tool in TOOLS)
        return TrackerFrame(number, time_s, tools)

    def close(self) -> None:
        """Release the tracker; a second call does nothing."""
        self._closed = True

    def _sample(self, tool: str, time_s: float, white: Floats) -> ToolSample:
        if tool in self._settings.hidden_tools:
            return ToolSample(tool, "covered")
        pose = self._true_pose(tool, time_s)
        if pose is None:
            return ToolSample(tool, "out_of_view")
        seen = observe(GEOMETRIES[tool], pose, white, self._settings.profile, self._seed)
        if seen.fit is None:
            return ToolSample(tool, seen.status)
        return ToolSample(tool, seen.status, seen.fit.T_tracker_marker, seen.fit.rms_error_mm)
