"""The tracker between captures: it watches tools in real time, and hands can put them somewhere.

Nothing seen here enters a session: captures have a clock and a motion of their own.
"""

from typing import Protocol, cast

from rona_core.devices.protocols import Rig
from rona_core.devices.samples import TrackerFrame
from rona_core.devices.settings import TrackerSettings
from rona_core.geometry.pose import Pose


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
