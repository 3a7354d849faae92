"""Messages of the toy step."""

from rona_core.app.messages.message import message


@message
class FitToyLine:
    """Fit a line to the toy readings."""

    slope: float = 1.0


@message
class StartToyCapture:
    """Read a toy instrument some times."""

    n: int = 3
