"""Messages that take what was recorded, measured or planned elsewhere."""

from typing import Literal

from rona_core.app.messages.message import message
from rona_core.app.runtime.saving.session_files import FILE_NAME, plain_name
from rona_core.devices.limits import limited

MOST_NAMES = 40


@message
class StartImport:
    """Take an uploaded file as the captures of its steps, and compute what follows at once.

    `captures` is an HDF5 file as RONA exports it (``captures.h5``): tracked A-scans, joints,
    forces, strokes; ``only`` names those that are wanted. `cloud` (PLY, CSV) is the surface in
    `base`, `path` (CSV, `.mrk.json`) the scan path in `base`, in mm. `motion` (CSV,
    JointTrajectory, URScript, a bag of ROS 2) is the motion of the scan, driven as ROS joins its
    samples; it becomes the plan of step 7, which the verifier certifies or refuses.
    """

    file: str = limited(**FILE_NAME)
    purpose: Literal["captures", "cloud", "path", "motion"] = "captures"
    only: tuple[str, ...] = limited((), maxItems=MOST_NAMES, maxLength=40)

    def __post_init__(self) -> None:
        plain_name(self.file)
