"""Messages of the registration of the burr."""

from rona_core.app.messages.message import message
from rona_core.app.steps.tool.messages import HALF_ANGLE, RegisterTool, StartToolCapture
from rona_core.devices.limits import like, number


@message
class StartBurrCapture:
    """Let the robot turn the spindle about its tip in a seat, while the tracker watches; register.

    A pointed pin as long as the burrs is in the chuck, its point in a fixed seat, and the arm
    yields to it.
    """

    cone_deg: float = number(30.0, "Pivot cone", "deg", 10.0, 45.0, 1.0, hint=HALF_ANGLE)
    n_pivot: int = like(StartToolCapture, "n_pivot")


@message
class RegisterBurr:
    """Compute where the tip of the burr is on the flange, from the recorded turns in the seat."""

    exclude: tuple[int, ...] = like(RegisterTool, "exclude")
