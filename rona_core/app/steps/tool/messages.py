"""Messages of the tool registration."""

from dataclasses import MISSING
from typing import Literal

from rona_core.app.messages.message import message
from rona_core.devices.limits import ROW, number

HALF_ANGLE = "Half-angle of the cone that the shaft sweeps"


@message
class RegisterTool:
    """Compute tool tip and tracker pose from the recorded tool motion."""

    method: Literal["joint", "paper"] = "joint"
    exclude: tuple[int, ...] = number(
        (),
        "Excluded poses",
        "",
        *ROW,
        1,
        hint="Left out by hand; rows of the residuals of the result",
        maxItems=20_000,
        uniqueItems=True,
    )


@message
class StartToolCapture:
    """Let the robot pivot and translate the tool while the tracker watches; then register."""

    cone_deg: float = number(20.0, "Pivot cone", "deg", 5.0, 45.0, 1.0, hint=HALF_ANGLE)
    n_pivot: int = number(30, "Pivot poses", "", 5, 200, 1, hint="Of the tool about its tip")
    n_translate: int = number(
        10, "Poses per axis", "", 3, 60, 1, hint="Along x, and as many along y of the tool"
    )


@message
class StartRobotMove:
    """Move the robot to joint angles in degrees; refused unless the motion is certified."""

    joints_deg: tuple[float, float, float, float, float, float] = number(
        MISSING,
        "Joint angles",
        "deg",
        -360.0,
        360.0,
        1.0,
        rule="within the limits of the joints of the chosen robot",
    )
