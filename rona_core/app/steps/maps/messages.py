"""Messages of detection and mapping."""

from typing import Literal

from rona_core.app.messages.message import message, within
from rona_core.devices.limits import PLACE, limited
from rona_core.mapping.second_pass import SecondPassSettings

Corner = tuple[float, float]  # u and v in the plane of the maps, in mm
MAX_ROWS = 500
Row = tuple[Corner, Corner]  # start and end of a line


@message
class StartMapping:
    """Detect both skull boundaries in the A-scans, map them and fuse the pointer cloud.

    Without a speed of sound it is the calibrated one, place by place, else the published one.
    """

    method: Literal["subtract", "matched", "threshold"] = "subtract"
    # None: calibrated, else published: 2.45 to 2.85
    sound_speed_mm_per_us: float | None = within(1.5, 4.5, default=None)
    cell_mm: float = within(0.5, 5.0, default=1.0)


@message
class StartGapPlan(SecondPassSettings):
    """Plan a further scan with the probe leaning towards the inner table, over the gaps of its map.

    Or along lines that are given, such as those that tell most of an implant bed (step 10).
    """

    # in the order of scanning; none: over the gaps
    rows: tuple[Row, ...] = limited((), **PLACE, maxItems=MAX_ROWS)


@message
class StartGapScan:
    """Let the robot execute the second pass while the probe records A-scans."""
