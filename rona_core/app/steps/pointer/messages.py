"""Messages of the pointer calibration.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.app.steps.tool.messages import require_rows
from rona_core.devices.settings import (
    STRICT,
    require_within,
)


@dataclass(frozen=True, slots=True)
class CalibratePointer:
    """Compute the pointer tip from the recorded pivoting."""

    __pydantic_config__: ClassVar = STRICT
    method: Literal["ml", "sphere"] = "ml"
    exclude: tuple[int, ...] = ()  # poses left out by hand, rows of the result's residuals

    def __post_init__(self) -> None:
        require_rows(self.exclude)


@dataclass(frozen=True, slots=True)
class StartPointerCapture:
    """Pivot the pointer about its tip while the tracker watches; then calibrate.

    With ``by_hand`` it runs in real time for at most ``duration_s`` and the pointer turns as
    somebody says meanwhile; ``cone_deg`` then means nothing.
    """

    __pydantic_config__: ClassVar = STRICT
    cone_deg: float = 30.0
    duration_s: float = 15.0
    by_hand: bool = False

    def __post_init__(self) -> None:
        require_within("cone_deg", self.cone_deg, 1.0, 60.0)
        require_within("duration_s", self.duration_s, 1.0, 120.0)


@dataclass(frozen=True, slots=True)
class ExcludePoses:
    """Leave single poses out of a calibration by hand, and compute it again from the others.

    ``indices`` are all that shall be left out, as rows of the result's residuals; none counts all
    poses again. The method stays what it was.
    """

    __pydantic_config__: ClassVar = STRICT
    step: Literal["tool", "pointer"]
    indices: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        require_rows(self.indices)
