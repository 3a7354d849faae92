"""Messages of every session, whatever its steps.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar

from rona_core.devices.settings import (
    STRICT,
    require,
)

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class RenameSession:
    """Give the session another name."""

    __pydantic_config__: ClassVar = STRICT
    name: str

    def __post_init__(self) -> None:
        require(0 < len(self.name.strip()) <= 80, "name must have 1 to 80 characters")


@dataclass(frozen=True, slots=True)
class Undo:
    """Take the last change back."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class Redo:
    """Do again what was taken back."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class StartReplay:
    """Compute every result again from the captures and compare; the session stays as it is.

    Results that are stale are left out. What was found is the `result` of the job.
    """

    __pydantic_config__: ClassVar = STRICT
