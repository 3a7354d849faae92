"""Virtual tracker between captures: real time, with pointers placed by hand."""

import threading
import time
from collections.abc import Callable

import numpy as np

from rona_core.devices.samples import ToolSample, TrackerFrame
from rona_core.devices.settings import TOOLS, TrackerSettings
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DeviceError, NotFoundError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Pose, Poses
from rona_core.virtual.tracker.faults import drift_mm, dropped, swapped_markers
from rona_core.virtual.tracker.tracker import (
    ViewConditions,
    observe,
    white_numbers,
)

Clear = Callable[[str, Poses], Bools]  # tool, true poses (n,) -> markers (n, m) not hidden


def all_clear(tool: str, Ts_tracker_marker: Poses) -> Bools:
    """Return that nothing hides any marker (n, m)."""
    return np.ones((len(Ts_tracker_marker), len(GEOMETRIES[tool].positions_marker)), dtype=np.bool_)


class VirtualLiveTracker:
    """Sees what stands before the tracker now; satisfies ``devices.LiveTracker``.

    Frames are numbered in real time. The noise of a frame depends on seed and number only.
    """

    def __init__(
        self,
        seed: int,
        T_tracker_toolmarker: Callable[[], Pose | None],
        T_tracker_basemarker: Callable[[], Pose | None] = lambda: None,
        T_tracker_headmarker: Callable[[], Pose | None] = lambda: None,
        *,
        clear: Clear = all_clear,
        share: float = 1.0,
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        """Watch the tool on the robot, the marker on its base and that on the head through these.

        Its error is ``share`` of what its maker states.
        """
        self._seed, self._share = seed, share
        self._fixed = {
            "toolmarker": T_tracker_toolmarker,
            "basemarker": T_tracker_basemarker,
            "headmarker": T_tracker_headmarker,
        }
        self._clear = clear
        self._wall = wall
        self._start_s = wall()
        self._lock = threading.Lock()
        self._placed: dict[str, Pose] = {}

    def place(self, tool: str, T_tracker_marker: Pose | None) -> None:
        """Put a pointer somewhere before the tracker; None lays it aside.

        Raises:
            NotFoundError: there is no such tool.
            DeviceError: the robot holds it.
        """
        if tool not in TOOLS:
            raise NotFoundError(f"there is no tool {tool!r}: tools are {', '.join(TOOLS)}")
        if tool == "toolmarker":
            raise DeviceError("the robot holds the toolmarker: move the robot instead")
        if tool == "basemarker":
            raise DeviceError("the basemarker is fixed to the robot base: move the base instead")
        if tool == "headmarker":
            raise DeviceError("the headmarker is fixed to the head, which lies in its clamp")
        with self._lock:
            self._placed.pop(tool, None)
            if T_tracker_marker is not None:
                self._placed[tool] = T_tracker_marker

    def frame(self, settings: TrackerSettings) -> TrackerFrame:
        """Return the newest frame, measured with these settings."""
        number = int((self._wall() - self._start_s) * settings.rate_hz)
        while dropped(settings, self._seed, 0, number):
            number -= 1
        with self._lock:
            placed = dict(self._placed)
        numbers = np.array([number])
        white = white_numbers(self._seed, "live tracker", 0, numbers)
        poses = {tool: pose() for tool, pose in self._fixed.items()} | placed
        samples = tuple(
            self._sample(tool, poses.get(tool), white[tool], settings, numbers) for tool in TOOLS
        )
        return TrackerFrame(number, number / settings.rate_hz, samples)

    def _sample(
        self,
        tool: str,
        T_tracker_marker: Pose | None,
        white: Floats,
        settings: TrackerSettings,
        numbers: Ints,
    ) -> ToolSample:
        if tool in settings.hidden_tools:
            return ToolSample(tool, "covered")
        if T_tracker_marker is None:
            return ToolSample(tool, "out_of_view")
        geometry, Ts = GEOMETRIES[tool], Poses.stack([T_tracker_marker])
        conditions = ViewConditions(
            clear=self._clear(tool, Ts) if settings.occlusion else None,
            drift=drift_mm(settings, self._seed, 0, numbers / settings.rate_hz),
            swapped=swapped_markers(settings, geometry, self._seed, 0, numbers),
            share=self._share,
        )
        return observe(geometry, Ts, white, settings, self._seed, conditions)[0]
