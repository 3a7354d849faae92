"""What can be asked of the SonoPointer: the ultrasound probe in the hand, tracked, no robot.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.app.steps.maps.messages import StartMapping
from rona_core.devices.settings import STRICT, require, require_within

MOST_SHOTS = 16_000  # of one scan by hand: some 60 MB


@dataclass(frozen=True, slots=True)
class CalibrateHandheldProbe:
    """Find the face and the axis of the probe from its pivoting and its turning."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class StartHandheldCalibration:
    """Pivot the SonoPointer with a calibration point, turn it in a bush; then calibrate it.

    ``half_turn_deg`` is how far it turns either way; the tracker loses it beyond about 60 degrees.
    """

    __pydantic_config__: ClassVar = STRICT
    cone_deg: float = 30.0
    pivot_s: float = 15.0
    half_turn_deg: float = 70.0
    spin_s: float = 15.0

    def __post_init__(self) -> None:
        require_within("cone_deg", self.cone_deg, 1.0, 60.0)
        require_within("pivot_s", self.pivot_s, 1.0, 120.0)
        require_within("half_turn_deg", self.half_turn_deg, 1.0, 85.0)
        require_within("spin_s", self.spin_s, 1.0, 120.0)


@dataclass(frozen=True, slots=True)
class StartHandheldScan:
    """Slide the SonoPointer over the region in lines by hand while it fires ``rate_hz`` times."""

    __pydantic_config__: ClassVar = STRICT
    duration_s: float = 60.0
    spacing_mm: float = 2.0
    rate_hz: float = 25.0

    def __post_init__(self) -> None:
        require_within("duration_s", self.duration_s, 5.0, 600.0)
        require_within("spacing_mm", self.spacing_mm, 0.5, 10.0)
        require_within("rate_hz", self.rate_hz, 1.0, 100.0)
        require(
            self.duration_s * self.rate_hz <= MOST_SHOTS,
            f"duration_s times rate_hz must be at most {MOST_SHOTS} A-scans, "
            f"not {self.duration_s * self.rate_hz:.0f}",
        )


@dataclass(frozen=True, slots=True)
class StartHandheldMapping:
    """Detect both boundaries in the A-scans of the hand-held probe, and map them.

    Without a speed of sound it is the calibrated one, if the maps are in base, else the published.
    """

    __pydantic_config__: ClassVar = STRICT
    method: Literal["subtract", "matched", "threshold"] = "subtract"
    sound_speed_mm_per_us: float | None = None  # None: calibrated, else published: 2.45 to 2.85
    cell_mm: float = 1.0

    def __post_init__(self) -> None:
        StartMapping(self.method, self.sound_speed_mm_per_us, self.cell_mm)  # refuses the same
