"""Latest-value slots of the devices, for the views."""

import threading
from dataclasses import dataclass, fields
from typing import Any, Protocol, cast

from rona_core.devices.protocols import Origin, Rig
from rona_core.devices.samples import AScan, JointSample, TrackerFrame
from rona_core.devices.settings import TrackerSettings
from rona_core.devices.wrench import ForceNow
from rona_core.geometry.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class RecordedSoFar:
    """What a scan under way has recorded, in its order; what comes later is added at the end."""

    scans: tuple[AScan, ...]
    joints: tuple[JointSample, ...]


@dataclass(frozen=True, slots=True, eq=False)
class LiveState:
    """The newest of everything; None where nothing has come yet."""

    frame: TrackerFrame | None = None
    joints: JointSample | None = None
    ascan: AScan | None = None
    n_scans: int = 0
    force: ForceNow | None = None  # of the scan under way, or the last one
    origin: Origin | None = None  # of the frame where it is not that of the devices
    ordinal: int = 0  # of the capture under way, or the last one
    recorded: RecordedSoFar | None = None  # of the scan under way
    frames: tuple[TrackerFrame, ...] = ()  # of the stroke of the pointer under way


PARTS = frozenset(field.name for field in fields(LiveState))


class Live:
    """Holds parts of a LiveState; writers replace them, readers get a consistent snapshot.

    It is written a thousand times as often as it is read, so a snapshot is made when it is asked
    for.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._parts: dict[str, Any] = {}

    def put(self, **parts: Any) -> None:
        """Replace the named parts of the state.

        Raises:
            TypeError: the state has no part of that name.
        """
        if not parts.keys() <= PARTS:
            raise TypeError(f"LiveState has no {', '.join(sorted(parts.keys() - PARTS))}")
        with self._lock:
            self._parts.update(parts)

    def clear(self) -> None:
        """Forget everything: it was said by devices that are no more."""
        with self._lock:
            self._parts.clear()

    def get(self) -> LiveState:
        """Return the state now; it never changes afterwards."""
        with self._lock:
            return LiveState(**self._parts)


class LiveTracker(Protocol):
    """A tracker that can be watched while no capture runs."""

    def frame(self, settings: TrackerSettings) -> TrackerFrame:
        """Return the newest frame, measured with these settings."""
        ...

    def place(self, tool: str, T_tracker_marker: Pose | None) -> None:
        """Put a pointer somewhere before the tracker; None lays it aside.

        Raises:
            DeviceError: this tool cannot be put anywhere by hand.
        """
        ...


def live_tracker_of(rig: Rig) -> LiveTracker | None:
    """Return the live tracker of a rig, or None where it has none."""
    return cast("LiveTracker | None", getattr(rig, "live_tracker", None))
