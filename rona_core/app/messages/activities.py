"""Activities: they take time or touch a device, and end in outcomes.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.app.messages.commands import Point
from rona_core.app.runtime.saving.file_names import plain_name
from rona_core.devices.settings import STRICT, require, require_within
from rona_core.mapping.second_pass import SecondPassSettings
from rona_core.robot.base_placement.candidates import BaseSearch
from rona_core.session.document import RegionChoice

MAX_PICKS = 500
MAX_FILES = 5000
MAX_PLACES = 2000  # of the base, that are looked at


@dataclass(frozen=True, slots=True)
class StartSkullImport:
    """Read a skull from a file that was uploaded before: mask, CT with threshold, or mesh."""

    __pydantic_config__: ClassVar = STRICT
    file: str
    inner_file: str | None = None
    threshold: float | None = None
    center_mesh_mm: Point | None = None
    radius_mm: float = 25.0

    def __post_init__(self) -> None:
        plain_name(self.file)
        if self.inner_file is not None:
            plain_name(self.inner_file)
        RegionChoice(self.center_mesh_mm, self.radius_mm)  # refuses what is no region


@dataclass(frozen=True, slots=True)
class StartRecordingImport:
    """Take a recording of a tracker (`.igs.mha`, uploaded before) as a capture of the pointer.

    Its purpose says which: the pivoting, a stroke over the surface, or the scan path; then what
    follows from it is computed. ``tool`` names the tool meant where the recording has several.
    ``append`` adds a stroke to those recorded before; ``play`` shows it at the pace of captures.
    """

    __pydantic_config__: ClassVar = STRICT
    file: str
    purpose: Literal["pivot", "surface", "path"] = "pivot"
    tool: str | None = None
    append: bool = False
    play: bool = False

    def __post_init__(self) -> None:
        plain_name(self.file)


@dataclass(frozen=True, slots=True)
class StartPivotImport:
    """Take a pivot that was recorded elsewhere (uploaded before) as that of the pointer; calibrate.

    The files hold one 4 x 4 matrix each, or sixteen numbers a row, or `frame,marker,x,y,z` in mm
    with the markers of the tool as ``geometry`` (`marker,x,y,z` or `.rom`), or are one `.igs.mha`.
    A zip stands for the files in it.
    """

    __pydantic_config__: ClassVar = STRICT
    files: tuple[str, ...]
    geometry: str | None = None
    tool: str | None = None

    def __post_init__(self) -> None:
        count = len(self.files)
        require(1 <= count <= MAX_FILES, f"files must be 1 to {MAX_FILES}, not {count}")
        for name in self.files:
            plain_name(name)
        if self.geometry is not None:
            plain_name(self.geometry)


@dataclass(frozen=True, slots=True)
class StartToolCapture:
    """Let the robot pivot and translate the tool while the tracker watches; then register."""

    __pydantic_config__: ClassVar = STRICT
    cone_deg: float = 20.0
    n_pivot: int = 30
    n_translate: int = 10  # along tool x, and as many along tool y

    def __post_init__(self) -> None:
        require_within("cone_deg", self.cone_deg, 5.0, 45.0)
        require_within("n_pivot", self.n_pivot, 5, 200)
        require_within("n_translate", self.n_translate, 3, 60)


@dataclass(frozen=True, slots=True)
class StartPointerCapture:
    """Pivot the pointer about its tip while the tracker watches; then calibrate.

    With ``by_hand`` it runs in real time for at most ``duration_s`` and the pointer turns as
    somebody says meanwhile; ``cone_deg`` then means nothing.
    """

    __pydantic_config__: ClassVar = STRICT
    cone_deg: float = 30.0
    duration_s: float = 15.0
    by_hand: bool = False

    def __post_init__(self) -> None:
        require_within("cone_deg", self.cone_deg, 1.0, 60.0)
        require_within("duration_s", self.duration_s, 1.0, 120.0)


@dataclass(frozen=True, slots=True)
class StartSurfaceCapture:
    """Slide the pointer over the skull; then build the cloud.

    Without picks the operator sweeps the region; with picks (places on the drawn skull, in base)
    the pointer follows them. ``append`` adds a stroke to those recorded before.
    """

    __pydantic_config__: ClassVar = STRICT
    duration_s: float = 60.0
    picks_base_mm: tuple[Point, ...] = ()
    append: bool = False

    def __post_init__(self) -> None:
        require_within("duration_s", self.duration_s, 1.0, 600.0)
        require(len(self.picks_base_mm) <= MAX_PICKS, f"at most {MAX_PICKS} picks, please")


@dataclass(frozen=True, slots=True)
class StartSkullRegistration:
    """Find where the loaded skull lies in base, by laying the surface points onto its surface.

    Without a guess every turn about the middle of the region is tried, from ``n_turns`` starts.
    A guess, e.g. of the visit before, is the pose of the skull's file in base: ``guess_wxyz`` and
    ``guess_mm``; it must hold within about 10 degrees and 10 mm.
    """

    __pydantic_config__: ClassVar = STRICT
    n_turns: int = 24
    guess_wxyz: tuple[float, float, float, float] | None = None
    guess_mm: Point | None = None

    def __post_init__(self) -> None:
        require_within("n_turns", self.n_turns, 4, 90)
        require(
            (self.guess_wxyz is None) == (self.guess_mm is None),
            "a guess needs both guess_wxyz and guess_mm",
        )


@dataclass(frozen=True, slots=True)
class StartPathCapture:
    """Demonstrate the scan path with the pointer; then build the path.

    Without picks the operator draws a meander over the region; with picks (in base) the pointer
    follows them.
    """

    __pydantic_config__: ClassVar = STRICT
    duration_s: float = 40.0
    spacing_mm: float = 4.0
    picks_base_mm: tuple[Point, ...] = ()

    def __post_init__(self) -> None:
        require_within("duration_s", self.duration_s, 1.0, 600.0)
        require_within("spacing_mm", self.spacing_mm, 1.0, 20.0)
        count = len(self.picks_base_mm)
        require(count == 0 or 2 <= count <= MAX_PICKS, f"picks must be 2 to {MAX_PICKS}")


@dataclass(frozen=True, slots=True)
class StartRollSearch:
    """Search the roll about the probe axis that the robot can traverse; plan, time and verify.

    The mode ``auto`` takes a constant roll, and one that varies along the path where none will do.
    """

    __pydantic_config__: ClassVar = STRICT
    n_rolls: int = 72
    roll_from_deg: float = 0.0
    roll_to_deg: float = 360.0
    choice: Literal["best", "first"] = "best"
    mode: Literal["auto", "constant", "variable"] = "auto"

    def __post_init__(self) -> None:
        require_within("n_rolls", self.n_rolls, 1, 720)
        require(
            -360.0 <= self.roll_from_deg < self.roll_to_deg <= 720.0,
            "rolls must lie within -360 and 720 degrees, first below last",
        )


@dataclass(frozen=True, slots=True)
class StartBasePlacement:
    """Search places of the robot's base from which the path can be scanned, best and nearest.

    Places are looked at ``step_mm`` apart, up to ``half_x_mm`` and ``half_y_mm`` to either side of
    where the base stands, at heights ``levels_mm`` from there.
    """

    __pydantic_config__: ClassVar = STRICT
    half_x_mm: float = 500.0
    half_y_mm: float = 600.0
    step_mm: float = 100.0
    levels_mm: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        self.search()  # refuses what cannot be searched

    def search(self) -> BaseSearch:
        """Return where to look.

        Raises:
            InvalidInputError: no such search, or one of too many places.
        """
        for level_mm in self.levels_mm:
            require_within("levels_mm", level_mm, -1000.0, 1000.0)
        wanted = BaseSearch(self.half_x_mm, self.half_y_mm, self.step_mm, self.levels_mm)
        across, along = (2 * int(v / self.step_mm) + 1 for v in (self.half_x_mm, self.half_y_mm))
        places = across * along * len(self.levels_mm)
        require(places <= MAX_PLACES, f"{places} places are too many: at most {MAX_PLACES}")
        return wanted


@dataclass(frozen=True, slots=True)
class StartScan:
    """Let the robot execute the certified plan while the probe records A-scans."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class StartGapPlan:
    """Plan a second scan over the gaps of the inner map, the probe leaning towards its table."""

    __pydantic_config__: ClassVar = STRICT
    spacing_mm: float = 1.0
    fan: float = 0.10  # by which neighbouring rows differ in the slope they expect
    largest_lean_deg: float = 6.0

    def __post_init__(self) -> None:
        SecondPassSettings(self.spacing_mm, self.fan, self.largest_lean_deg)


@dataclass(frozen=True, slots=True)
class StartGapScan:
    """Let the robot execute the second pass while the probe records A-scans."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class StartMapping:
    """Detect both skull boundaries in the A-scans, map them and fuse the pointer cloud.

    Without a speed of sound it is the calibrated one, place by place, else the published one.
    """

    __pydantic_config__: ClassVar = STRICT
    method: Literal["subtract", "matched", "threshold"] = "subtract"
    sound_speed_mm_per_us: float | None = None  # None: calibrated, else published: 2.45 to 2.85
    cell_mm: float = 1.0

    def __post_init__(self) -> None:
        if self.sound_speed_mm_per_us is not None:
            require_within("sound_speed_mm_per_us", self.sound_speed_mm_per_us, 1.5, 4.5)
        require_within("cell_mm", self.cell_mm, 0.5, 5.0)


@dataclass(frozen=True, slots=True)
class StartReplay:
    """Compute every result again from the captures and compare; the session stays as it is.

    Results that are stale are left out. What was found is the `result` of the job.
    """

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class StartRetract:
    """Draw the probe straight back along its axis from the bone it stands on, as after a stop.

    The line is certified first; where the probe stands clear of everything it is refused.
    """

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class StartRobotMove:
    """Move the robot to joint angles in degrees; refused unless the motion is certified."""

    __pydantic_config__: ClassVar = STRICT
    joints_deg: tuple[float, float, float, float, float, float]
