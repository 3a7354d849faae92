"""The milling tool in the robot's hand: a motor spindle with its burr, clamped in the tool holder.

RONA holds a surgical motor of 30000 rpm (Aesculap microtron EC/GD622) perpendicular to the flange;
its drawing is not published. Every length here is assumed, for the reason beside it, and rather too
thick than too thin. The tip is that of the calibrated tool: a stop in the spindle brings every burr
to the same length.
"""

import math
from dataclasses import dataclass

from rona_core.devices.limits import require_within

Profile = tuple[tuple[float, float], ...]  # radius and height in mm, in ``tip``

OCTAGON = math.tan(math.pi / 8.0)  # half a side of an octagon about a circle of radius 1
BODY: Profile = (
    (4.0, -30.0),  # nose: a chuck of 6 mm for shanks of 2.35 mm, with its bearing
    (5.0, -45.0),  # slim, so that the surgeon sees the burr
    (10.0, -70.0),  # handpieces are as thick as a pencil grip there
    (13.0, -91.0),  # where the holder clamps, like the probe: its ring is 28 mm thick
    (13.0, -150.0),  # motor: these are 20 to 25 mm thick, and stand out behind the holder
)


@dataclass(frozen=True, slots=True)
class Spindle:
    """Motor, nose, and the burr that stands out of it; turned about z of ``tip``."""

    burr_radius_mm: float = 2.5  # of the largest burr that is used
    shank_radius_mm: float = 1.2  # of the common shank of 2.35 mm; smaller balls have thinner necks
    body: Profile = BODY  # begins at the nose, out of which the burr stands

    def __post_init__(self) -> None:
        require_within("burr_radius_mm", self.burr_radius_mm, 0.25, 6.0)
        require_within("shank_radius_mm", self.shank_radius_mm, 0.1, 3.0)

    @property
    def burr(self) -> Profile:
        """Return the burr, a ball within eight tangents, with its shank up to the nose."""
        radius, (_, nose_mm) = self.burr_radius_mm, self.body[0]
        near, far = radius * (1.0 - OCTAGON), radius * (1.0 + OCTAGON)
        return (
            (radius * OCTAGON, 0.0),
            (radius, -near),
            (radius, -far),
            (self.shank_radius_mm, nose_mm),
        )
