"""Virtual tracker between captures: real time, with pointers placed by hand."""

import threading
import time
from collections.abc import Callable

from rona_core.devices.marker_geometry import GEOMETRIES, MarkerGeometry
from rona_core.devices.samples import ToolSample, TrackerFrame
from rona_core.devices.settings import TOOLS, TrackerSettings
from rona_core.errors import DeviceError, NotFoundError
from rona_core.geometry.pose import Pose
from rona_core.virtual.noise import rng
from rona_core.virtual.tracker.faults import drift_mm, dropped, swapped_markers
from rona_core.virtual.tracker.tracker import Clear, ViewConditions, sample_tool


class VirtualLiveTracker:
    """Sees what stands before the tracker now; satisfies ``devices.LiveTracker``.

    Frames are numbered in real time. The noise of a frame depends on seed and number only.
    """

    def __init__(
        self,
        seed: int,
        T_tracker_toolmarker: Callable[[], Pose | None],
        T_tracker_basemarker: Callable[[], Pose | None] = lambda: None,
        *,
        clear: Clear | None = None,
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        """Watch the tool on the robot and the marker on its base through these two.

        Without ``clear`` nothing ever stands before a marker.
        """
        self._seed = seed
        self._fixed = {"toolmarker": T_tracker_toolmarker, "basemarker": T_tracker_basemarker}
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
        generator = rng(self._seed, "live tracker", 0, number)
        drift = drift_mm(settings, self._seed, 0, number / settings.rate_hz)
        visible = self._clear if settings.occlusion else None

        def conditions(geometry: MarkerGeometry, pose: Pose) -> ViewConditions:
            return ViewConditions(
                clear=None if visible is None else visible(geometry.tool, pose, 0.0),
                drift=drift,
                swapped=swapped_markers(settings, geometry, self._seed, 0, number),
            )

        samples: list[ToolSample] = []
        for tool in TOOLS:
            white = generator.standard_normal(GEOMETRIES[tool].positions_marker.shape)
            pose = self._fixed[tool]() if tool in self._fixed else placed.get(tool)
            samples.append(sample_tool(tool, pose, white, settings, self._seed, conditions))
        return TrackerFrame(number, number / settings.rate_hz, tuple(samples))
