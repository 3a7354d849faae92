"""Messages of detection and mapping.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.devices.settings import (
    STRICT,
    require_within,
)
from rona_core.mapping.second_pass import SecondPassSettings


@dataclass(frozen=True, slots=True)
class StartMapping:
    """Detect both skull boundaries in the A-scans, map them and fuse the pointer cloud.

    Without a speed of sound it is the calibrated one, place by place, else the published one.
    """

    __pydantic_config__: ClassVar = STRICT
    method: Literal["subtract", "matched", "threshold"] = "subtract"
    sound_speed_mm_per_us: float | None = None  # None: calibrated, else published: 2.45 to 2.85
    cell_mm: float = 1.0

    def __post_init__(self) -> None:
        if self.sound_speed_mm_per_us is not None:
            require_within("sound_speed_mm_per_us", self.sound_speed_mm_per_us, 1.5, 4.5)
        require_within("cell_mm", self.cell_mm, 0.5, 5.0)


@dataclass(frozen=True, slots=True)
class StartGapPlan:
    """Plan a second scan over the gaps of the inner map, the probe leaning towards its table."""

    __pydantic_config__: ClassVar = STRICT
    spacing_mm: float = 1.0
    fan: float = 0.10  # by which neighbouring rows differ in the slope they expect
    largest_lean_deg: float = 6.0

    def __post_init__(self) -> None:
        SecondPassSettings(self.spacing_mm, self.fan, self.largest_lean_deg)


@dataclass(frozen=True, slots=True)
class StartGapScan:
    """Let the robot execute the second pass while the probe records A-scans."""

    __pydantic_config__: ClassVar = STRICT
