"""Messages of the pointer calibration."""

from typing import Literal

from rona_core.app.messages.message import message
from rona_core.app.steps.tool.messages import HALF_ANGLE, RegisterTool
from rona_core.devices.limits import choice, like, number


@message
class CalibratePointer:
    """Compute the pointer tip from the recorded pivoting."""

    method: Literal["ml", "sphere"] = choice(
        "ml",
        "Method",
        {"ml": "Maximum likelihood", "sphere": "Sphere (paper)"},
        "Of the fit; the first one is recommended",
    )
    exclude: tuple[int, ...] = like(RegisterTool, "exclude")


@message
class StartPointerCapture:
    """Pivot the pointer about its tip while the tracker watches; then calibrate.

    With ``by_hand`` it runs in real time for at most ``duration_s`` and the pointer turns as
    a person says meanwhile; ``cone_deg`` then means nothing.
    """

    cone_deg: float = number(30.0, "Cone", "deg", 1.0, 60.0, 1.0, hint=HALF_ANGLE)
    duration_s: float = number(
        15.0, "Duration", "s", 1.0, 120.0, 1.0, hint="Length of the recording"
    )
    by_hand: bool = False


@message
class ExcludePoses:
    """Leave single poses out of a calibration by hand, and compute it again from the others.

    ``indices`` are all that shall be left out, as rows of the result's residuals; none counts all
    poses again. The method stays what it was.
    """

    step: Literal["tool", "pointer"]
    indices: tuple[int, ...] = like(CalibratePointer, "exclude")
