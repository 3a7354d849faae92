"""Everything that can be asked of a session, as frozen dataclasses of plain values.

Commands change the session at once and purely. Activities take time or touch a device and end in
outcomes. Both are public: the browser, REST and scripts send the same ones. Lengths are in
millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

from rona_core.devices.settings import (
    STRICT,
    TOOLS,
    Excitation,
    PointerKind,
    ProbeName,
    TrackerProfile,
    require,
)

Point = tuple[float, float, float]
MAX_PICKS = 500


def _within(name: str, value: float, low: float, high: float) -> None:
    require(low <= value <= high, f"{name} must be {low:g} to {high:g}, not {value:g}")


# ------------------------------------------------------------------ commands: step 1, set-up


@dataclass(frozen=True, slots=True)
class RenameSession:
    """Give the session another name."""

    __pydantic_config__: ClassVar = STRICT
    name: str

    def __post_init__(self) -> None:
        require(0 < len(self.name.strip()) <= 80, "name must have 1 to 80 characters")


@dataclass(frozen=True, slots=True)
class SetSeed:
    """Choose the seed of all that is random: the patient, the placement and every noise."""

    __pydantic_config__: ClassVar = STRICT
    seed: int

    def __post_init__(self) -> None:
        _within("seed", self.seed, 0, 2**31 - 1)


@dataclass(frozen=True, slots=True)
class UseSimulatedSkull:
    """Put a simulated skull on the table; the seed decides which patient it is."""

    __pydantic_config__: ClassVar = STRICT
    side: Literal["left", "right"] = "left"


@dataclass(frozen=True, slots=True)
class SetRegion:
    """Choose the disc to be scanned; without a centre RONA chooses one."""

    __pydantic_config__: ClassVar = STRICT
    center_mesh_mm: Point | None = None
    radius_mm: float = 25.0

    def __post_init__(self) -> None:
        _within("radius_mm", self.radius_mm, 5.0, 45.0)


@dataclass(frozen=True, slots=True)
class SetTracker:
    """Choose noise profile and frame rate of the tracker."""

    __pydantic_config__: ClassVar = STRICT
    profile: TrackerProfile = "polaris"
    rate_hz: float = 60.0


@dataclass(frozen=True, slots=True)
class SetToolVisible:
    """Cover a tracked tool up, or uncover it."""

    __pydantic_config__: ClassVar = STRICT
    tool: str
    visible: bool

    def __post_init__(self) -> None:
        require(self.tool in TOOLS, f"tool must be one of {', '.join(TOOLS)}, not {self.tool!r}")


@dataclass(frozen=True, slots=True)
class SetRobot:
    """Choose the robot, whether it errs, its scan speed and where its base stands."""

    __pydantic_config__: ClassVar = STRICT
    model: str = "rx90"
    errors: bool = True
    scan_speed_mm_per_s: float = 20.0
    base_shift_mm: Point = (0.0, 0.0, 0.0)
    base_turn_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class SetProbe:
    """Choose the ultrasound probe, its excitation, signal-to-noise ratio and scan pitch."""

    __pydantic_config__: ClassVar = STRICT
    name: ProbeName = "2.25MHz"
    excitation: Excitation = "chirp"
    front_snr_db: float = 50.0
    pitch_mm: float = 1.0


@dataclass(frozen=True, slots=True)
class SetPointer:
    """Choose the hand-held pointer: 6D (markers in a plane) or 5D (markers on a line)."""

    __pydantic_config__: ClassVar = STRICT
    kind: PointerKind = "pointer6d"


# ------------------------------------------------------------------ commands: steps 2 to 7


@dataclass(frozen=True, slots=True)
class RegisterTool:
    """Compute tool tip and tracker pose from the recorded tool motion."""

    __pydantic_config__: ClassVar = STRICT
    method: Literal["paper"] = "paper"


@dataclass(frozen=True, slots=True)
class CalibratePointer:
    """Compute the pointer tip from the recorded pivoting."""

    __pydantic_config__: ClassVar = STRICT
    method: Literal["sphere", "aos"] = "sphere"


@dataclass(frozen=True, slots=True)
class BuildSurface:
    """Compute the surface point cloud from the recorded strokes of the pointer."""

    __pydantic_config__: ClassVar = STRICT
    average_s: float = 0.1  # length of the moving average along a stroke

    def __post_init__(self) -> None:
        _within("average_s", self.average_s, 0.0, 2.0)


@dataclass(frozen=True, slots=True)
class ClearSurface:
    """Forget the recorded strokes, to sample the surface anew."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class BuildPath:
    """Compute the demonstrated path from the recorded stroke of the pointer."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class SmoothScanPath:
    """Remove path points within a bound, and give each kept one its surface normal."""

    __pydantic_config__: ClassVar = STRICT
    tolerance_mm: float = 1.0
    metric: Literal["k1", "k2", "k3"] = "k1"
    method: Literal["greedy", "optimal"] = "greedy"
    filter_s: float = 0.05  # sigma of the zero-phase filter before; 0 switches it off
    normal_radius_mm: float = 10.0
    normal_method: Literal["ols", "tls"] = "ols"

    def __post_init__(self) -> None:
        _within("tolerance_mm", self.tolerance_mm, 0.01, 20.0)
        _within("filter_s", self.filter_s, 0.0, 1.0)
        _within("normal_radius_mm", self.normal_radius_mm, 2.0, 40.0)


@dataclass(frozen=True, slots=True)
class ChooseRoll:
    """Plan and verify the scan with another roll of the search (its index, from 0)."""

    __pydantic_config__: ClassVar = STRICT
    index: int

    def __post_init__(self) -> None:
        _within("index", self.index, 0, 9999)


@dataclass(frozen=True, slots=True)
class Undo:
    """Take the last change back."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class Redo:
    """Do again what was taken back."""

    __pydantic_config__: ClassVar = STRICT


# ------------------------------------------------------------------ activities


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
        for name in (self.file, self.inner_file or "x"):
            plain = name not in ("", ".", "..") and "/" not in name and "\\" not in name
            require(plain, f"file must be the plain name of an uploaded file, not {name!r}")
        _within("radius_mm", self.radius_mm, 5.0, 45.0)


@dataclass(frozen=True, slots=True)
class StartToolCapture:
    """Let the robot pivot and translate the tool while the tracker watches; then register."""

    __pydantic_config__: ClassVar = STRICT
    cone_deg: float = 20.0
    n_pivot: int = 30
    n_translate: int = 10  # along tool x, and as many along tool y

    def __post_init__(self) -> None:
        _within("cone_deg", self.cone_deg, 5.0, 45.0)
        _within("n_pivot", self.n_pivot, 5, 200)
        _within("n_translate", self.n_translate, 3, 60)


@dataclass(frozen=True, slots=True)
class StartPointerCapture:
    """Pivot the pointer about its tip while the tracker watches; then calibrate."""

    __pydantic_config__: ClassVar = STRICT
    cone_deg: float = 30.0
    duration_s: float = 15.0

    def __post_init__(self) -> None:
        _within("cone_deg", self.cone_deg, 1.0, 60.0)
        _within("duration_s", self.duration_s, 1.0, 120.0)


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
        _within("duration_s", self.duration_s, 1.0, 600.0)
        require(len(self.picks_base_mm) <= MAX_PICKS, f"at most {MAX_PICKS} picks, please")


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
        _within("duration_s", self.duration_s, 1.0, 600.0)
        _within("spacing_mm", self.spacing_mm, 1.0, 20.0)
        count = len(self.picks_base_mm)
        require(count == 0 or 2 <= count <= MAX_PICKS, f"picks must be 2 to {MAX_PICKS}")


@dataclass(frozen=True, slots=True)
class StartRollSearch:
    """Search the roll about the probe axis that the robot can traverse; plan, time and verify."""

    __pydantic_config__: ClassVar = STRICT
    n_rolls: int = 72
    roll_from_deg: float = 0.0
    roll_to_deg: float = 360.0
    choice: Literal["best", "first"] = "best"

    def __post_init__(self) -> None:
        _within("n_rolls", self.n_rolls, 1, 720)
        require(
            -360.0 <= self.roll_from_deg < self.roll_to_deg <= 720.0,
            "rolls must lie within -360 and 720 degrees, first below last",
        )


@dataclass(frozen=True, slots=True)
class StartScan:
    """Let the robot execute the certified plan while the probe records A-scans."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class StartMapping:
    """Detect both skull boundaries in the A-scans, map them and fuse the pointer cloud."""

    __pydantic_config__: ClassVar = STRICT
    method: Literal["subtract", "matched", "threshold"] = "subtract"
    sound_speed_mm_per_us: float = 2.65  # mean of tables and diploe; published: 2.45 to 2.85
    cell_mm: float = 1.0

    def __post_init__(self) -> None:
        _within("sound_speed_mm_per_us", self.sound_speed_mm_per_us, 1.5, 4.5)
        _within("cell_mm", self.cell_mm, 0.5, 5.0)


@dataclass(frozen=True, slots=True)
class StartRobotMove:
    """Move the robot to joint angles in degrees; refused unless the motion is certified."""

    __pydantic_config__: ClassVar = STRICT
    joints_deg: tuple[float, float, float, float, float, float]


Command = (
    RenameSession
    | SetSeed
    | UseSimulatedSkull
    | SetRegion
    | SetTracker
    | SetToolVisible
    | SetRobot
    | SetProbe
    | SetPointer
    | RegisterTool
    | CalibratePointer
    | BuildSurface
    | ClearSurface
    | BuildPath
    | SmoothScanPath
    | ChooseRoll
    | Undo
    | Redo
)
Activity = (
    StartSkullImport
    | StartToolCapture
    | StartPointerCapture
    | StartSurfaceCapture
    | StartPathCapture
    | StartRollSearch
    | StartScan
    | StartMapping
    | StartRobotMove
)
COMMANDS: dict[str, type] = {kind.__name__: kind for kind in get_args(Command)}
ACTIVITIES: dict[str, type] = {kind.__name__: kind for kind in get_args(Activity)}
