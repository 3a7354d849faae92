"""Messages of the registration of the burr."""

from rona_core.app.messages.message import message, within
from rona_core.app.steps.tool.messages import POSES
from rona_core.devices.limits import limited


@message
class StartBurrCapture:
    """Let the robot turn the spindle about its tip in a seat, while the tracker watches; register.

    A pointed pin as long as the burrs is in the chuck, its point in a fixed seat, and the arm
    yields to it.
    """

    cone_deg: float = within(10.0, 45.0, default=30.0)
    n_pivot: int = within(5, 200, default=30)


@message
class RegisterBurr:
    """Compute where the tip of the burr is on the flange, from the recorded turns in the seat."""

    # poses left out by hand, rows of the result's residuals
    exclude: tuple[int, ...] = limited((), **POSES)
