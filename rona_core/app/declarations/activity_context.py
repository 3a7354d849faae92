"""What an activity may use: devices, live slots, a way to compute, and to be cancelled."""

from collections.abc import Callable
from concurrent.futures import CancelledError as PoolCancelled
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeVar

from rona_core.devices.live import Live
from rona_core.devices.protocols import Cancel, Progress, Rig, never, silent
from rona_core.errors import CancelledError
from rona_core.session.specimen import LoadedSkull
from rona_core.ultrasound.acoustic_calibration.expected_performance import WhatIf

T = TypeVar("T")
ImportSkull = Callable[..., LoadedSkull]
Sweep = Callable[..., WhatIf]


class Compute(Protocol):
    """Run a pure function of picklable arguments; it takes ``progress`` and ``cancel`` too."""

    def __call__(
        self, function: Callable[..., T], *args: object, progress: Progress, cancel: Cancel
    ) -> T:
        """Return ``function(*args, progress=…, cancel=…)``, computed here or elsewhere.

        Raises:
            CancelledError: somebody cancelled.
        """
        ...


def compute_here(
    function: Callable[..., T], *args: object, progress: Progress, cancel: Cancel
) -> T:
    """Compute in this thread: for scripts and tests."""
    try:
        return function(*args, progress=progress, cancel=cancel)
    except PoolCancelled as error:
        raise CancelledError("cancelled") from error


@dataclass(frozen=True, slots=True)
class ActivityContext:
    """Handed to an activity when it starts."""

    devices: Callable[[], Rig]  # built when they are asked for: computing needs none
    live: Live
    import_skull: ImportSkull
    uploads: Path
    compute: Compute = compute_here
    sweep: Sweep | None = None  # None where there are no virtual plates to try probes on
    progress: Progress = field(default=silent)
    cancel: Cancel = field(default=never)

    @property
    def rig(self) -> Rig:
        """The devices."""
        return self.devices()

    def run(self, function: Callable[..., T], *args: object) -> T:
        """Return ``function(*args)``, computed where ``compute`` does, watched and cancellable.

        Raises:
            CancelledError: somebody cancelled.
        """
        return self.compute(function, *args, progress=self.progress, cancel=self.cancel)
