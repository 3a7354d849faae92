"""Messages of the set-up.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.app.messages.session_messages import Point
from rona_core.app.runtime.saving.file_names import plain_name
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
)
from rona_core.session.document import RegionChoice, require_seed
from rona_core.session.specimen import BoneKind


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
