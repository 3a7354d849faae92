"""Messages of detection and mapping."""

from typing import Literal

from rona_core.app.messages.message import Point, message
from rona_core.app.runtime.saving.session_files import FILE_NAME, plain_name
from rona_core.devices.limits import PLACE_MM, choice, limited, number
from rona_core.mapping.comparison.reference_bone import Registration
from rona_core.mapping.tilted_passes import TiltSettings

Corner = tuple[float, float]  # u and v in the plane of the maps, in mm
MAX_ROWS = 500
MAX_PAIRS = 200
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
class StartTiltPlan(TiltSettings):
    """Plan further passes over the whole scan path with the probe tilted, each another way.

    Or one along lines that are given, such as those that say most about an implant bed (step 10).
    """

    # in the order of scanning; none: over the whole path
    rows: tuple[Row, ...] = number((), "Rows", "mm", *PLACE_MM, 0.5, maxItems=MAX_ROWS)


@message
class StartTiltScan:
    """Let the robot scan the next of the planned passes while the probe records A-scans."""


@message
class StartComparison:
    """Compare the robot's maps with an uploaded reference; the session stays as it is.

    The reference is a mesh (STL, PLY, OBJ, mm; closed: both tables, open: the outer one), a mask or
    a CT (NRRD, NIfTI), or a session file. ``register`` lays it under the outer map (`surface`), by
    three or more pairs of points (`points`), or by both in turn; of a CT what has ``threshold`` or
    more is bone. What was found is the `result` of the job.
    """

    file: str = limited(**FILE_NAME)
    register: Registration = choice(
        "none",
        "Registration",
        {
            "none": "None",
            "surface": "By its surface",
            "points": "By pairs of points",
            "both": "By both",
        },
        "How the reference is laid under the outer map",
    )
    points_reference_mm: tuple[Point, ...] = number(
        (), "Points of the reference", "mm", *PLACE_MM, 0.5, maxItems=MAX_PAIRS
    )
    points_base_mm: tuple[Point, ...] = number(
        (), "Points of the maps", "mm", *PLACE_MM, 0.5, maxItems=MAX_PAIRS
    )
    threshold: float | None = number(
        None, "Bone threshold", "", -1e9, 1e9, 50.0, hint="Grey value, as the file has them"
    )

    def __post_init__(self) -> None:
        plain_name(self.file)
