"""Commands about the robot: how it presses the probe on, and where its base stands."""

from dataclasses import dataclass, fields
from typing import ClassVar, Literal

from rona_core.devices.settings import STRICT, ContactSettings


@dataclass(frozen=True, slots=True)
class SetContact:
    """Choose whether the probe is pressed on with a set force, and the limits of doing so.

    With ``pressed`` false the robot is driven by position alone, and the other fields are idle.
    """

    __pydantic_config__: ClassVar = STRICT
    pressed: bool = True
    force_n: float = 3.0  # set point along the tool axis
    travel_mm: float = 5.0  # by which the motion may be corrected, either way
    approach_mm_per_s: float = 2.0
    monitor_n: float = 10.0  # above it the scan halts and the probe yields
    stop_n: float = 20.0  # above it everything stops
    period_ms: float = 16.0  # of the control loop
    delay_ms: float = 32.0  # until the robot begins a correction
    lag_ms: float = 20.0  # with which it then follows

    def __post_init__(self) -> None:
        self.settings()  # refuses what is out of range

    def settings(self) -> ContactSettings | None:
        """Return what the robot is set to; None: driven by position alone."""
        names = [field.name for field in fields(ContactSettings)]
        chosen = ContactSettings(**{name: getattr(self, name) for name in names})
        return chosen if self.pressed else None


@dataclass(frozen=True, slots=True)
class ApplyBasePlacement:
    """Move the robot's base to the place that was found: the most roomy one or the nearest.

    The tracker is registered to the base: tool, surface, path and all that follows are then to be
    done again.
    """

    __pydantic_config__: ClassVar = STRICT
    place: Literal["best", "smallest"] = "smallest"
