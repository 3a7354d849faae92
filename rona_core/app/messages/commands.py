"""Commands: they change the session at once and purely.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.devices.settings import (
    ROOM_C,
    STRICT,
    TOOLS,
    Excitation,
    PointerKind,
    ProbeName,
    PulseShape,
    TrackerPlace,
    TrackerProfile,
    require,
    require_within,
)
from rona_core.session.document import RegionChoice, require_seed
from rona_core.session.specimen import BoneKind

Point = tuple[float, float, float]
MAX_EXCLUDED = 20_000


def require_rows(rows: tuple[int, ...]) -> None:
    """Raise InvalidInputError unless ``rows`` number poses, each once."""
    require(len(rows) <= MAX_EXCLUDED, f"at most {MAX_EXCLUDED} poses, please")
    require(all(row >= 0 for row in rows), "poses are numbered from 0")
    require(len(set(rows)) == len(rows), "each pose can be named once only")


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
        require_seed(self.seed)


@dataclass(frozen=True, slots=True)
class UseSimulatedSkull:
    """Put a simulated skull on the table; the seed decides which patient it is."""

    __pydantic_config__: ClassVar = STRICT
    side: Literal["left", "right"] = "left"


@dataclass(frozen=True, slots=True)
class SetBoneModel:
    """Choose what the bone on the table is made of: its texture, and whose speed of sound it has.

    Only the virtual probe knows it; what detects the echoes does not.
    """

    __pydantic_config__: ClassVar = STRICT
    kind: BoneKind = "normal"
    own_speed: bool = True


@dataclass(frozen=True, slots=True)
class SetRegion:
    """Choose the disc to be scanned; without a centre RONA chooses one."""

    __pydantic_config__: ClassVar = STRICT
    center_mesh_mm: Point | None = None
    radius_mm: float = 25.0

    def __post_init__(self) -> None:
        RegionChoice(self.center_mesh_mm, self.radius_mm)  # refuses what is no region


@dataclass(frozen=True, slots=True)
class SetTracker:
    """Choose noise profile, frame rate and faults of the tracker."""

    __pydantic_config__: ClassVar = STRICT
    profile: TrackerProfile = "polaris"
    rate_hz: float = 60.0
    stereo: bool = True
    depth_ratio: float = 3.0
    occlusion: bool = True
    phantom_share: float = 0.0
    latency_ms: float | None = None
    drift_mm: float = 0.0
    minutes_on: float = 60.0
    dropped_share: float = 0.0


@dataclass(frozen=True, slots=True)
class MoveTracker:
    """Move the tracker: shifted from its first place, turned about its vertical there.

    What was recorded stays valid; new strokes are taken from the new place.
    """

    __pydantic_config__: ClassVar = STRICT
    shift_mm: Point = (0.0, 0.0, 0.0)
    turn_deg: float = 0.0

    def __post_init__(self) -> None:
        TrackerPlace(self.shift_mm, self.turn_deg)  # refuses what is too far


@dataclass(frozen=True, slots=True)
class SetUseBaseMarker:
    """Choose whether a tracker that has moved is found again by the marker on the robot base."""

    __pydantic_config__: ClassVar = STRICT
    use_base_marker: bool = True


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
    centre_mhz: float | None = None  # None: as the named probe has it
    bandwidth: float | None = None
    aperture_mm: float | None = None
    line_length_mm: float | None = None
    pulse_shape: PulseShape | None = None
    adc_bits: int | None = None
    gain_db: float = 0.0
    line_temperature_c: float = ROOM_C


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
    method: Literal["joint", "paper"] = "joint"
    exclude: tuple[int, ...] = ()  # poses left out by hand, rows of the result's residuals

    def __post_init__(self) -> None:
        require_rows(self.exclude)


@dataclass(frozen=True, slots=True)
class CalibratePointer:
    """Compute the pointer tip from the recorded pivoting."""

    __pydantic_config__: ClassVar = STRICT
    method: Literal["ml", "sphere", "aos"] = "ml"
    exclude: tuple[int, ...] = ()  # poses left out by hand, rows of the result's residuals

    def __post_init__(self) -> None:
        require_rows(self.exclude)


@dataclass(frozen=True, slots=True)
class ExcludePoses:
    """Leave single poses out of a calibration by hand, and compute it again from the others.

    ``indices`` are all that shall be left out, as rows of the result's residuals; none counts all
    poses again. The method stays what it was.
    """

    __pydantic_config__: ClassVar = STRICT
    step: Literal["tool", "pointer"]
    indices: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        require_rows(self.indices)


@dataclass(frozen=True, slots=True)
class BuildSurface:
    """Compute the surface point cloud from the recorded strokes of the pointer."""

    __pydantic_config__: ClassVar = STRICT
    average_s: float = 0.1  # length of the moving average along a stroke

    def __post_init__(self) -> None:
        require_within("average_s", self.average_s, 0.0, 2.0)


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
    method: Literal["greedy", "optimal", "fast", "rdp"] = "optimal"
    filter_s: float = 0.05  # sigma of the zero-phase filter before; 0 switches it off
    normal_radius_mm: float | None = None  # None: noise, density and curvature decide
    normal_method: Literal["jet", "tls", "ols", "robust"] = "jet"
    normal_step_mm: float = 3.0  # between normals along the path; 0: at the kept points alone

    def __post_init__(self) -> None:
        require_within("tolerance_mm", self.tolerance_mm, 0.01, 20.0)
        require_within("filter_s", self.filter_s, 0.0, 1.0)
        if self.normal_radius_mm is not None:
            require_within("normal_radius_mm", self.normal_radius_mm, 2.0, 40.0)
        require_within("normal_step_mm", self.normal_step_mm, 0.0, 50.0)


@dataclass(frozen=True, slots=True)
class ChooseRoll:
    """Plan and verify the scan with another roll of the search (its index, from 0)."""

    __pydantic_config__: ClassVar = STRICT
    index: int
    branch: int | None = None  # one that is ranked for this roll; None: that with the most room

    def __post_init__(self) -> None:
        require_within("index", self.index, 0, 9999)
        if self.branch is not None:
            require_within("branch", self.branch, 0, 7)


@dataclass(frozen=True, slots=True)
class Undo:
    """Take the last change back."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class Redo:
    """Do again what was taken back."""

    __pydantic_config__: ClassVar = STRICT
