"""Messages of detection and mapping."""

from typing import Literal

from rona_core.app.messages.message import message
from rona_core.devices.limits import PLACE_MM, choice, number
from rona_core.mapping.second_pass import SecondPassSettings

Corner = tuple[float, float]  # u and v in the plane of the maps, in mm
MAX_ROWS = 500
Row = tuple[Corner, Corner]  # start and end of a line


@message
class StartMapping:
    """Detect both skull boundaries in the A-scans, map them and fuse the pointer cloud.

    Without a speed of sound it is the calibrated one, place by place, else the published one.
    """

    method: Literal["subtract", "matched", "threshold"] = choice(
        "subtract",
        "Detection",
        {
            "subtract": "Front echo subtracted",
            "matched": "Matched filter (paper)",
            "threshold": "Threshold (paper)",
        },
        "Algorithm that finds the echoes; the first one is recommended",
    )
    sound_speed_mm_per_us: float | None = number(
        None,
        "Sound speed",
        "mm/µs",
        1.5,
        4.5,
        0.01,
        hint="In bone",
        none="calibrated, else published",
    )
    cell_mm: float = number(
        1.0, "Cell size", "mm", 0.5, 5.0, 0.5, hint="Of the maps; smaller shows more, takes longer"
    )


@message
class StartGapPlan(SecondPassSettings):
    """Plan a further scan with the probe leaning towards the inner table, over the gaps of its map.

    Or along lines that are given, such as those that tell most of an implant bed (step 10).
    """

    # in the order of scanning; none: over the gaps
    rows: tuple[Row, ...] = number((), "Rows", "mm", *PLACE_MM, 0.5, maxItems=MAX_ROWS)


@message
class StartGapScan:
    """Let the robot execute the second pass while the probe records A-scans."""
