"""Messages of detection and mapping."""

from typing import Literal

from rona_core.app.messages.message import Point, message, within
from rona_core.app.runtime.saving.session_files import FILE_NAME, plain_name
from rona_core.devices.limits import PLACE, limited
from rona_core.mapping.comparison.reference_bone import Registration
from rona_core.mapping.second_pass import SecondPassSettings

Corner = tuple[float, float]  # u and v in the plane of the maps, in mm
MAX_ROWS = 500
MAX_PAIRS = 200
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


@message
class StartComparison:
    """Compare the robot's maps with an uploaded reference; the session stays as it is.

    The reference is a mesh (STL, PLY, OBJ, mm; closed: both tables, open: the outer one), a mask or
    a CT (NRRD, NIfTI), or a session file. ``register`` lays it under the outer map (`surface`), by
    three or more pairs of points (`points`), or by both in turn; of a CT what has ``threshold`` or
    more is bone. What was found is the `result` of the job.
    """

    file: str = limited(**FILE_NAME)
    register: Registration = "none"
    points_reference_mm: tuple[Point, ...] = limited((), **PLACE, maxItems=MAX_PAIRS)
    points_base_mm: tuple[Point, ...] = limited((), **PLACE, maxItems=MAX_PAIRS)
    threshold: float | None = within(-1e9, 1e9, default=None)  # grey value, as the file has them

    def __post_init__(self) -> None:
        plain_name(self.file)
