"""Messages of the pointer calibration."""

from typing import Literal

from rona_core.app.messages.message import message, within
from rona_core.app.steps.tool.messages import POSES
from rona_core.devices.limits import limited


@message
class CalibratePointer:
    """Compute the pointer tip from the recorded pivoting."""

    method: Literal["ml", "sphere"] = "ml"
    # poses left out by hand, rows of the result's residuals
    exclude: tuple[int, ...] = limited((), **POSES)


@message
class StartPointerCapture:
    """Pivot the pointer about its tip while the tracker watches; then calibrate.

    With ``by_hand`` it runs in real time for at most ``duration_s`` and the pointer turns as
    somebody says meanwhile; ``cone_deg`` then means nothing.
    """

    cone_deg: float = within(1.0, 60.0, default=30.0)
    duration_s: float = within(1.0, 120.0, default=15.0)
    by_hand: bool = False


@message
class ExcludePoses:
    """Leave single poses out of a calibration by hand, and compute it again from the others.

    ``indices`` are all that shall be left out, as rows of the result's residuals; none counts all
    poses again. The method stays what it was.
    """

    step: Literal["tool", "pointer"]
    indices: tuple[int, ...] = limited((), **POSES)
