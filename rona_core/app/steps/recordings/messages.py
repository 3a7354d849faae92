"""Messages that take recordings made elsewhere."""

from typing import Literal

from rona_core.app.messages.message import message
from rona_core.app.runtime.saving.session_files import FILE_NAME, plain_name
from rona_core.devices.limits import limited

MAX_FILES = 5000
MAX_TOOL = 100  # characters of its name
MAX_COLUMNS = 2000  # characters of their names


@message
class StartRecordingImport:
    """Take a recording of a tracker (uploaded before) as a capture of the pointer.

    Its purpose says which: the pivoting, a stroke over the surface, or the scan path; then what
    follows from it is computed. ``tool`` names the tool meant where the recording has several.
    ``append`` adds a stroke to those recorded before; ``play`` shows it at the pace of captures.
    """

    file: str = limited(**FILE_NAME)
    purpose: Literal["pivot", "surface", "path"] = "pivot"
    tool: str | None = limited(None, maxLength=MAX_TOOL)
    columns: str | None = limited(None, maxLength=MAX_COLUMNS)
    quaternion: Literal["wxyz", "xyzw"] | None = None
    unit: Literal["mm", "cm", "m"] | None = None
    frame: str | None = limited(None, maxLength=MAX_TOOL)
    append: bool = False
    play: bool = False

    def __post_init__(self) -> None:
        plain_name(self.file)


@message
class StartPivotImport:
    """Take a pivot that was recorded elsewhere (uploaded before) as that of the pointer; calibrate.

    The files hold one matrix each, or a pose a row (matrix, or position and quaternion), or arrays
    (`.npy`, `.npz`, `.mat`, `.json`), or `frame,marker,x,y,z` in mm with the markers of the tool as
    ``geometry`` (`marker,x,y,z` or `.rom`), or are one sequence of PLUS or one recording of ROS. A
    zip stands for the files in it. ``columns``, ``quaternion``, ``unit`` and ``frame`` say what the
    files do not. Poses in another convention than those of the marker in the tracker are refused by
    the name of the change.
    """

    files: tuple[str, ...] = limited(**FILE_NAME, minItems=1, maxItems=MAX_FILES)
    geometry: str | None = limited(None, **FILE_NAME)
    tool: str | None = limited(None, maxLength=MAX_TOOL)
    columns: str | None = limited(None, maxLength=MAX_COLUMNS)
    quaternion: Literal["wxyz", "xyzw"] | None = None
    unit: Literal["mm", "cm", "m"] | None = None
    frame: str | None = limited(None, maxLength=MAX_TOOL)

    def __post_init__(self) -> None:
        for name in self.files:
            plain_name(name)
        if self.geometry is not None:
            plain_name(self.geometry)
