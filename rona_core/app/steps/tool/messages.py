"""Messages of the tool registration."""

from typing import Annotated, Literal

from rona_core.app.messages.lengths import Length
from rona_core.app.messages.message import message, within
from rona_core.devices.settings import require

MAX_EXCLUDED = 20_000
Rows = Annotated[tuple[int, ...], Length(0, MAX_EXCLUDED)]


def require_rows(rows: tuple[int, ...]) -> None:
    """Raise InvalidInputError unless ``rows`` number poses, each once."""
    require(len(rows) <= MAX_EXCLUDED, f"at most {MAX_EXCLUDED} poses, please")
    require(all(row >= 0 for row in rows), "poses are numbered from 0")
    require(len(set(rows)) == len(rows), "each pose can be named once only")


@message
class RegisterTool:
    """Compute tool tip and tracker pose from the recorded tool motion."""

    method: Literal["joint", "paper"] = "joint"
    exclude: Rows = ()  # poses left out by hand, rows of the result's residuals

    def __post_init__(self) -> None:
        require_rows(self.exclude)


@message
class StartToolCapture:
    """Let the robot pivot and translate the tool while the tracker watches; then register."""

    cone_deg: float = within(5.0, 45.0, default=20.0)
    n_pivot: int = within(5, 200, default=30)
    n_translate: int = within(3, 60, default=10)  # along tool x, and as many along tool y


@message
class StartRobotMove:
    """Move the robot to joint angles in degrees; refused unless the motion is certified."""

    joints_deg: tuple[float, float, float, float, float, float]
