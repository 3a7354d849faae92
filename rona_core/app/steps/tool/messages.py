"""Messages of the tool registration.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.devices.settings import (
    STRICT,
    require,
    require_within,
)


def require_rows(rows: tuple[int, ...]) -> None:
    """Raise InvalidInputError unless ``rows`` number poses, each once."""
    require(len(rows) <= MAX_EXCLUDED, f"at most {MAX_EXCLUDED} poses, please")
    require(all(row >= 0 for row in rows), "poses are numbered from 0")
    require(len(set(rows)) == len(rows), "each pose can be named once only")


MAX_EXCLUDED = 20_000


@dataclass(frozen=True, slots=True)
class RegisterTool:
    """Compute tool tip and tracker pose from the recorded tool motion."""

    __pydantic_config__: ClassVar = STRICT
    method: Literal["joint", "paper"] = "joint"
    exclude: tuple[int, ...] = ()  # poses left out by hand, rows of the result's residuals

    def __post_init__(self) -> None:
        require_rows(self.exclude)


@dataclass(frozen=True, slots=True)
class StartToolCapture:
    """Let the robot pivot and translate the tool while the tracker watches; then register."""

    __pydantic_config__: ClassVar = STRICT
    cone_deg: float = 20.0
    n_pivot: int = 30
    n_translate: int = 10  # along tool x, and as many along tool y

    def __post_init__(self) -> None:
        require_within("cone_deg", self.cone_deg, 5.0, 45.0)
        require_within("n_pivot", self.n_pivot, 5, 200)
        require_within("n_translate", self.n_translate, 3, 60)


@dataclass(frozen=True, slots=True)
class StartRobotMove:
    """Move the robot to joint angles in degrees; refused unless the motion is certified."""

    __pydantic_config__: ClassVar = STRICT
    joints_deg: tuple[float, float, float, float, float, float]
