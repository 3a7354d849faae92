"""Messages of the scan."""

from rona_core.app.messages.message import message
from rona_core.devices.limits import number


@message
class StartScan:
    """Let the robot execute the certified plan while the probe records A-scans."""


@message
class StartProbeMountingCapture:
    """Press the robot's probe on a gauge plate at its holder; then calibrate how it is mounted.

    The plate is of steel and presses the line by known depths, so that the echoes tell where the
    face of the probe is, and how fast its line is as warm as it is now.
    """

    n: int = number(10, "Number of A-scans", "", 3, 200, 1, hint="At each depth")


@message
class CalibrateProbeMounting:
    """Compute where the face of the robot's probe is from the A-scans on the gauge plate.

    Without ``use`` an earlier calibration is forgotten: the probe counts as mounted as drawn.
    """

    use: bool = True


@message
class StartQuickLook:
    """Look at short lines over the path with each probe by hand, and compare the probes.

    Each probe is held in a collar, upright and tilted as in the tilted passes. It says before the
    scan how far each probe would map the inner boundary.
    """

    lines: int = number(12, "Number of lines", "", 4, 60, 1, hint="Of 5 A-scans, over the path")


@message
class StartRetract:
    """Draw the probe straight back along its axis from the bone it stands on, as after a stop.

    The line is certified first; where the probe stands clear of everything it is refused.
    """


@message
class StartHome:
    """Drive the robot home from where it stands, as after a stop, on certified motions.

    A probe that stands on the bone is drawn straight back first.
    """
