"""The session document: inputs, captures and results of one planning, as one immutable value."""

import re
import uuid
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Generic, Literal, TypeVar

from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.handheld.tracked_probe import SonoCalibration
from rona_core.devices.samples import AScanTrack, JointTrack, ToolTrack
from rona_core.devices.settings import (
    FIRST_PLACE,
    DeviceSettings,
    TrackerPlace,
    require,
    require_within,
)
from rona_core.devices.workcell import Surroundings
from rona_core.devices.wrench import ForceTrack
from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.path5d import Path5D
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.second_pass import SecondPassPath
from rona_core.path.manual_edits import PathEdits
from rona_core.path.simplification.simplify import SimplifiedPath
from rona_core.robot.base_placement.candidates import BasePlacement
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.specimen import BoneChoice, LoadedSkull, SimulatedSkull
from rona_core.surface.cloud import SurfaceCloud
from rona_core.surface.icp import SurfaceRegistration
from rona_core.surface.normals.normals import Normals
from rona_core.ultrasound.acoustic_calibration.delay_line import DelayLine
from rona_core.ultrasound.acoustic_calibration.parameter_sweep import WhatIf
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits

T = TypeVar("T")
MAX_SEED = 2**31 - 1
MAX_NAME = 200  # characters
REGION_RADII_MM = (5.0, 45.0)  # smallest and largest
PLAIN_ID = re.compile(r"(?!current$)[A-Za-z0-9_-]{1,64}")  # "current" stands for another one

# The steps of the procedure, in order; `architecture.md` section 1 numbers them from 1.
STEPS = ("setup", "tool", "pointer", "surface", "path", "smoothing", "roll", "scan", "maps")


def require_seed(seed: int) -> None:
    """Raise InvalidInputError unless ``seed`` is one that all generators of random numbers take."""
    require(0 <= seed <= MAX_SEED, f"seed must be 0 to {MAX_SEED}, not {seed}")


@dataclass(frozen=True, slots=True)
class RegionChoice:
    """The disc to be scanned: its centre in coordinates of the specimen; None lets RONA choose."""

    center_mesh_mm: tuple[float, float, float] | None = None
    radius_mm: float = 25.0

    def __post_init__(self) -> None:
        center = self.center_mesh_mm or (0.0,)
        require(
            all(abs(part) <= 1e5 for part in center),
            f"center_mesh_mm must be numbers within 100 m, not {self.center_mesh_mm}",
        )
        require_within("radius_mm", self.radius_mm, *REGION_RADII_MM)


@dataclass(frozen=True, slots=True)
class Setup:
    """Step 1: what is scanned, with which devices, and the seed of all that is random."""

    seed: int = 0
    specimen: SimulatedSkull | LoadedSkull = field(default_factory=SimulatedSkull)
    region: RegionChoice = field(default_factory=RegionChoice)
    bone: BoneChoice = field(default_factory=BoneChoice)
    devices: DeviceSettings = field(default_factory=DeviceSettings)
    use_base_marker: bool = True  # to find a tracker again that was moved after the registration
    surroundings: Surroundings = field(default_factory=Surroundings)  # what collisions are with

    def __post_init__(self) -> None:
        require_seed(self.seed)


@dataclass(frozen=True, slots=True, eq=False)
class ToolCapture:
    """Step 2: the tool marker while the robot pivots and translates the tool, dwelling at poses."""

    ordinal: int
    setup_digest: str  # of the setup it was taken with
    marker: ToolTrack
    joints: JointTrack
    dwell_start_s: Floats  # (n,)
    dwell_end_s: Floats  # (n,)
    phases: Ints  # (n,) 0 pivot, 1 along tool x, 2 along tool y
    partial: bool = False
    base: ToolTrack | None = None  # the base marker meanwhile; None: nobody recorded it
    tracker_place: TrackerPlace = FIRST_PLACE  # as the set-up had it


@dataclass(frozen=True, slots=True, eq=False)
class PointerCapture:
    """Steps 3, 4 and 5: the pointer marker while somebody pivots, sweeps or draws."""

    ordinal: int
    setup_digest: str
    pointer: str  # which one, see devices.settings
    marker: ToolTrack
    partial: bool = False
    base: ToolTrack | None = None  # the base marker meanwhile; None: nobody recorded it
    tracker_place: TrackerPlace = FIRST_PLACE  # as the set-up had it


@dataclass(frozen=True, slots=True, eq=False)
class ScanCapture:
    """Step 8: A-scans, joint angles and forces, each with the time at which it arrived."""

    ordinal: int
    setup_digest: str
    scans: AScanTrack
    joints: JointTrack
    partial: bool = False
    forces: ForceTrack | None = None  # None: driven by position alone
    clock_scans: AScanTrack | None = None  # while pressing on and lifting: they tell the delay


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceCapture:
    """Step 9: places of known thickness, each along the probe's axis; for the speed of sound."""

    ordinal: int
    setup_digest: str
    places_base: Floats  # (n, 3) on the outer surface
    thickness_mm: Floats  # (n,)
    sigma_mm: Floats  # (n,) standard deviation of the caliper
    partial: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class BlockCapture:
    """Step 1: the probe at rest on a flat block of metal, a track for each temperature."""

    ordinal: int
    setup_digest: str
    tracks: tuple[AScanTrack, ...]
    temperatures_c: Floats  # (n,) of the delay line, by thermometer
    partial: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SonoCapture:
    """The probe in the hand: A-scans and the marker on the probe, on one clock."""

    ordinal: int
    setup_digest: str
    marker: ToolTrack
    scans: AScanTrack
    partial: bool = False
    base: ToolTrack | None = None  # the base marker meanwhile; None: nobody recorded it
    tracker_place: TrackerPlace = FIRST_PLACE  # as the set-up had it


@dataclass(frozen=True, slots=True)
class Captures:
    """What the devices measured; each can be redone."""

    tool: ToolCapture | None = None
    pointer: PointerCapture | None = None
    surface: tuple[PointerCapture, ...] = ()  # several strokes add up
    path: PointerCapture | None = None
    scan: ScanCapture | None = None
    second: ScanCapture | None = None  # step 9: again over the gaps, the probe leaning
    references: ReferenceCapture | None = None
    block: BlockCapture | None = None
    sono_pivot: PointerCapture | None = None  # the probe in the hand pivots on a calibration point
    sono_spin: PointerCapture | None = None  # and turns about its own axis
    sono_scan: SonoCapture | None = None  # and slides over the skull


@dataclass(frozen=True, slots=True, eq=False)
class RawPath:
    """Step 5: positions (n, 3) of the pointer tip, or of a pattern, in ``base``."""

    points_base: Floats


@dataclass(frozen=True, slots=True, eq=False)
class SmoothPath:
    """Step 6: the smoothed path, its surface normals and the dense 5D path made of both."""

    simplified: SimplifiedPath
    normals: Normals  # at the way-points
    path: Path5D  # interpolated densely in position and orientation
    way_points_base: Floats | None  # (m, 3) kept points and places between; None: the kept alone
    corners_base: Floats  # (k, 3) the kept points, filtered or placed by hand
    from_raw_mm: Floats  # (n,) how far each sample of the raw path is from the smoothed one
    from_filtered_mm: Floats  # (n,) the same of the samples behind the filter


@dataclass(frozen=True, slots=True, eq=False)
class SecondPass:
    """Step 9: how the gaps of the inner map are scanned again."""

    way: SecondPassPath
    plan: RobotPlan


@dataclass(frozen=True, slots=True, eq=False)
class SonoMaps:
    """Maps of a scan by hand, and what they are measured from."""

    maps: Maps
    frame: Literal["base", "basemarker"]  # that stands for ``base`` in the maps
    n_scans: int  # A-scans that were taken
    n_posed: int  # and of those, at which the tracker saw the probe
    delay_s: float  # by which frames of the tracker were taken to arrive late
    sentence: str  # about the frame, for people


@dataclass(frozen=True, slots=True, eq=False)
class Derived(Generic[T]):
    """A result, what was asked for, and digests of the inputs it was computed from."""

    value: T
    message: str  # name of the command or activity that made it
    arguments: dict[str, object]  # its fields, plain values
    inputs: dict[str, str]  # input name -> digest


@dataclass(frozen=True, slots=True)
class Results:
    """What was computed from the captures."""

    tool: Derived[ToolRegistration] | None = None
    pointer: Derived[PointerCalibration] | None = None
    surface: Derived[SurfaceCloud] | None = None
    registration: Derived[SurfaceRegistration] | None = None  # T_skull_base of a loaded skull
    path: Derived[RawPath] | None = None
    smoothing: Derived[SmoothPath] | None = None
    roll: Derived[RobotPlan] | None = None
    placement: Derived[BasePlacement] | None = None  # places of the robot's base
    what_if: Derived[WhatIf] | None = None  # of no specimen: how probes do on virtual plates
    line: Derived[DelayLine] | None = None  # of the probe, on a block
    detection: Derived[Detection] | None = None
    second: Derived[SecondPass] | None = None
    second_detection: Derived[Detection] | None = None  # of the A-scans of the second pass
    speed: Derived[SpeedCalibration] | None = None  # of sound, at places of known thickness
    maps: Derived[Maps] | None = None
    sono: Derived[SonoCalibration] | None = None  # of the probe in the hand
    sono_detection: Derived[Detection] | None = None  # at the A-scans whose pose is known
    sono_maps: Derived[SonoMaps] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LogEntry:
    """One message as it came in."""

    number: int
    message: str
    arguments: dict[str, object]  # plain values; captures appear as their ordinal and digest
    time_utc: str


Capture = ToolCapture | PointerCapture | ScanCapture | ReferenceCapture | BlockCapture | SonoCapture


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """Everything a session file holds."""

    id: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    name: str = "untitled"
    created_utc: str = field(
        default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds")
    )
    setup: Setup = field(default_factory=Setup)
    captures: Captures = field(default_factory=Captures)
    path_edits: PathEdits = field(default_factory=PathEdits)  # of the path of step 5, by hand
    boundary_edits: BoundaryEdits = field(default_factory=BoundaryEdits)  # of A-scans, by hand
    results: Results = field(default_factory=Results)
    archive: tuple[Capture, ...] = ()  # every capture ever taken, undone ones too
    log: tuple[LogEntry, ...] = ()

    def __post_init__(self) -> None:
        require(
            len(self.name) <= MAX_NAME,
            f"name must have at most {MAX_NAME} characters, not {len(self.name)}",
        )
        # addresses and file names are made of it
        require(bool(PLAIN_ID.fullmatch(self.id)), f"id must be plain, not {self.id[:60]!r}")
