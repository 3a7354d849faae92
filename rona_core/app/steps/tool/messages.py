"""Messages of the tool registration."""

from typing import Literal

from rona_core.app.messages.message import message, within
from rona_core.devices.limits import ROW, limited

POSES = {**ROW, "maxItems": 20_000, "uniqueItems": True}  # rows of the poses of a recording


@message
class RegisterTool:
    """Compute tool tip and tracker pose from the recorded tool motion."""

    method: Literal["joint", "paper"] = "joint"
    # poses left out by hand, rows of the result's residuals
    exclude: tuple[int, ...] = limited((), **POSES)


@message
class StartToolCapture:
    """Let the robot pivot and translate the tool while the tracker watches; then register."""

    cone_deg: float = within(5.0, 45.0, default=20.0)
    n_pivot: int = within(5, 200, default=30)
    n_translate: int = within(3, 60, default=10)  # along tool x, and as many along tool y


@message
class StartRobotMove:
    """Move the robot to joint angles in degrees; refused unless the motion is certified."""

    joints_deg: tuple[float, float, float, float, float, float] = within(
        -360.0, 360.0, rule="within the limits of the joints of the chosen robot"
    )
