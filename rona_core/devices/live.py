"""Latest-value slots: what the devices report now, for whoever draws it."""

import threading
from dataclasses import dataclass, replace
from typing import Any

from rona_core.devices.force import ForceNow
from rona_core.devices.protocols import Origin
from rona_core.devices.samples import AScan, JointSample, TrackerFrame


@dataclass(frozen=True, slots=True, eq=False)
class LiveState:
    """The newest of everything; None where nothing has come yet."""

    frame: TrackerFrame | None = None
    joints: JointSample | None = None
    ascan: AScan | None = None
    n_scans: int = 0
    force: ForceNow | None = None  # of the scan under way, or the last one
    origin: Origin | None = None  # of the frame where it is not that of the devices


class Live:
    """Holds one LiveState; writers replace parts of it, readers get a consistent snapshot."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._state = LiveState()

    def put(self, **parts: Any) -> None:
        """Replace the named parts of the state."""
        with self._lock:
            self._state = replace(self._state, **parts)

    def clear(self) -> None:
        """Forget everything: it was said by devices that are no more."""
        with self._lock:
            self._state = LiveState()

    def get(self) -> LiveState:
        """Return the state now; it never changes afterwards."""
        with self._lock:
            return self._state
