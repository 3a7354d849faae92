"""Messages that take recordings made elsewhere."""

from typing import Any, Literal

from rona_core.app.messages.message import message
from rona_core.app.runtime.saving.session_files import FILE_NAME, plain_name
from rona_core.devices.limits import choice, like, limited

MAX_FILES = 5000
MAX_TOOL = 100  # characters of its name
MAX_COLUMNS = 2000  # characters of their names
AS_NAMED = "as the file says"


def _text(label: str, most: int, hint: str, none: str) -> Any:
    """Declare a text that says what a file does not; null where it says it."""
    return limited(None, label=label, hint=hint, none=none, maxLength=most)


@message
class StartRecordingImport:
    """Take a recording of a tracker (uploaded before) as a capture of the pointer.

    Its purpose says which: the pivoting, a stroke over the surface, or the scan path; then what
    follows from it is computed. ``tool`` names the tool meant where the recording has several.
    ``append`` adds a stroke to those recorded before; ``play`` shows it at the pace of captures.
    """

    file: str = limited(**FILE_NAME)
    purpose: Literal["pivot", "surface", "path"] = "pivot"
    tool: str | None = _text("Tool", MAX_TOOL, "Name of the one meant, of several", "the only one")
    columns: str | None = _text(
        "Columns",
        MAX_COLUMNS,
        "Names of all columns, separated by commas: time,x,y,z,qx,qy,qz,qw; - for any other",
        AS_NAMED,
    )
    quaternion: Literal["wxyz", "xyzw"] | None = choice(
        None,
        "Quaternion",
        {"wxyz": "wxyz, real part first", "xyzw": "xyzw, real part last"},
        "Order of its numbers",
        none=AS_NAMED,
    )
    unit: Literal["mm", "cm", "m"] | None = choice(
        None,
        "Unit",
        {"mm": "mm", "cm": "cm", "m": "m"},
        "Of the positions",
        none="as named, else mm",
    )
    frame: str | None = _text(
        "Frame", MAX_TOOL, "That the poses are in, of several", "tracker, or the only one"
    )
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
    tool: str | None = like(StartRecordingImport, "tool")
    columns: str | None = like(StartRecordingImport, "columns")
    quaternion: Literal["wxyz", "xyzw"] | None = like(StartRecordingImport, "quaternion")
    unit: Literal["mm", "cm", "m"] | None = like(StartRecordingImport, "unit")
    frame: str | None = like(StartRecordingImport, "frame")

    def __post_init__(self) -> None:
        for name in self.files:
            plain_name(name)
        if self.geometry is not None:
            plain_name(self.geometry)
