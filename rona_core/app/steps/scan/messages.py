"""Messages of the scan."""

from rona_core.app.messages.message import message


@message
class StartScan:
    """Let the robot execute the certified plan while the probe records A-scans."""


@message
class StartRetract:
    """Draw the probe straight back along its axis from the bone it stands on, as after a stop.

    The line is certified first; where the probe stands clear of everything it is refused.
    """
