"""Messages of the toy step."""

from dataclasses import dataclass
from typing import ClassVar

from rona_core.devices.settings import STRICT


@dataclass(frozen=True, slots=True)
class FitToyLine:
    """Fit a line to the toy readings."""

    __pydantic_config__: ClassVar = STRICT
    slope: float = 1.0


@dataclass(frozen=True, slots=True)
class StartToyCapture:
    """Read a toy instrument some times."""

    __pydantic_config__: ClassVar = STRICT
    n: int = 3
