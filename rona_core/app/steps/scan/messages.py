"""Messages of the scan.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar

from rona_core.devices.settings import (
    STRICT,
)


@dataclass(frozen=True, slots=True)
class StartScan:
    """Let the robot execute the certified plan while the probe records A-scans."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class StartRetract:
    """Draw the probe straight back along its axis from the bone it stands on, as after a stop.

    The line is certified first; where the probe stands clear of everything it is refused.
    """

    __pydantic_config__: ClassVar = STRICT
