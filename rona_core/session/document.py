"""The session document: inputs, captures and results of one planning, as one immutable value."""

import re
import uuid
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from functools import cache
from typing import Any, Generic, Literal, TypeVar

from rona_core import __version__
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.handheld.tracked_probe import SonoCalibration
from rona_core.calibration.surface_registration import SurfaceRegistration
from rona_core.devices.limits import (
    PLACE_MM,
    number,
    require,
    require_limits,
    switch,
)
from rona_core.devices.settings import DeviceSettings
from rona_core.devices.workcell import Surroundings
from rona_core.devices.world_settings import WorldSettings
from rona_core.geometry.arrays import Floats
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.geometry.surface.normals.normals import Normals
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.tilted_passes import SecondPassPath
from rona_core.path.manual_edits import PathEdits
from rona_core.path.simplification.simplify import SimplifiedPath
from rona_core.path.zones import PaintedRegions
from rona_core.robot.base_placement.reachability import BasePlacement
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.captures import (
    BlockCapture,
    Capture,
    OpenCapture,
    PointerCapture,
    ReferenceCapture,
    ScanCapture,
    SonoCapture,
    ToolCapture,
)
from rona_core.session.codec import OMIT_EMPTY, OpenType
from rona_core.session.specimen import BoneChoice, LoadedSkull, SimulatedSkull
from rona_core.ultrasound.acoustic_calibration.delay_line import DelayLine
from rona_core.ultrasound.acoustic_calibration.expected_performance import WhatIf
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits

T = TypeVar("T")
# messages of older sessions: what they are called now, and fields that they have no more
RENAMED = {"StartGapPlan": ("StartTiltPlan", ("spacing_mm", "fan", "largest_lean_deg"))}
MAX_NAME = 200  # characters
TITLE = {  # what a session may be called
    "minLength": 1,
    "maxLength": 80,
    "pattern": r"^[\s\S]*\S[\s\S]*$",
    "rule": "1 to 80 characters, and not blanks alone",
}
PLAIN_ID = re.compile(r"(?!current$)[A-Za-z0-9_-]{1,64}")  # "current" stands for another one


@dataclass(frozen=True, slots=True)
class RegionChoice:
    """The disc to be scanned: its centre in coordinates of the specimen; None lets RONA choose."""

    center_mesh_mm: tuple[float, float, float] | None = number(
        None,
        "Region centre",
        "mm",
        *PLACE_MM,
        1.0,
        none="RONA chooses",
        rule="on the outer surface of the skull",
    )
    radius_mm: float = number(
        25.0, "Region radius", "mm", 5.0, 45.0, 1.0, hint="Of the skull to be scanned"
    )

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class Setup:
    """Step 1: what is scanned, with which devices, and the seed of all that is random."""

    # all generators of random numbers take it
    seed: int = number(0, "Seed", "", 0, 2**31 - 1, 1, hint="For patient, placement and noise")
    specimen: SimulatedSkull | LoadedSkull = field(default_factory=SimulatedSkull)
    region: RegionChoice = field(default_factory=RegionChoice)
    bone: BoneChoice = field(default_factory=BoneChoice)
    devices: DeviceSettings = field(default_factory=DeviceSettings)
    use_base_marker: bool = switch(
        True, "Base marker", "Locates a displaced tracker, with some loss of accuracy"
    )
    surroundings: Surroundings = field(default_factory=Surroundings)  # what collisions are with
    world: WorldSettings = field(default_factory=WorldSettings)  # of the virtual devices

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class Captures:
    """What the devices measured; each can be redone."""

    tool: ToolCapture | None = None
    pointer: PointerCapture | None = None
    surface: tuple[PointerCapture, ...] = ()  # several strokes add up
    path: PointerCapture | None = None
    scan: ScanCapture | None = None
    second: tuple[ScanCapture, ...] = ()  # step 9: passes over gaps, leaning; they add up
    references: ReferenceCapture | None = None
    block: BlockCapture | None = None
    sono_pivot: PointerCapture | None = None  # the probe in the hand pivots on a calibration point
    sono_spin: PointerCapture | None = None  # and turns about its own axis
    sono_scan: SonoCapture | None = None  # and slides over the skull
    more: dict[str, OpenCapture] = field(
        default_factory=dict[str, OpenCapture], metadata=OMIT_EMPTY
    )  # declared by steps

    def get(self, name: str) -> Any:
        """Return what is held under a name: a capture, several, or None (of strokes: ())."""
        return getattr(self, name) if name in _names(Captures) else self.more.get(name)

    def with_(self, name: str, held: Any) -> "Captures":
        """Return the captures with another one under this name; None: with none."""
        return _with(self, name, held)


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
    """Step 9: how the region is scanned again with the probe tilted; a pass, and those after it."""

    way: SecondPassPath
    plan: RobotPlan
    n_before: int = field(default=0, metadata=OMIT_EMPTY)  # further passes that it knew of
    following: tuple["SecondPass", ...] = field(default=(), metadata=OMIT_EMPTY)

    @property
    def passes(self) -> tuple["SecondPass", ...]:
        """All passes of the plan in the order of scanning."""
        return (self, *self.following)

    def scanned(self, held: tuple[ScanCapture, ...]) -> int:
        """Return how many of its passes were scanned to the end, of all further ones held."""
        whole = len(held) - self.n_before - bool(held and held[-1].partial)
        return min(max(whole, 0), len(self.passes))

    def next_pass(self, held: tuple[ScanCapture, ...]) -> "SecondPass | None":
        """Return the pass to be scanned next; None where all are scanned."""
        done = self.scanned(held)
        return self.passes[done] if done < len(self.passes) else None


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
    version: str = __version__  # of the program that made it

    def __post_init__(self) -> None:
        if self.message in RENAMED:
            name, gone = RENAMED[self.message]
            kept = {key: value for key, value in self.arguments.items() if key not in gone}
            object.__setattr__(self, "message", name)
            object.__setattr__(self, "arguments", kept)


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
    second_detection: Derived[Detection] | None = None  # of all A-scans of further passes
    speed: Derived[SpeedCalibration] | None = None  # of sound, at places of known thickness
    maps: Derived[Maps] | None = None
    sono: Derived[SonoCalibration] | None = None  # of the probe in the hand
    sono_detection: Derived[Detection] | None = None  # at the A-scans whose pose is known
    sono_maps: Derived[SonoMaps] | None = None
    more: dict[str, Derived[OpenType]] = field(
        default_factory=dict[str, "Derived[OpenType]"], metadata=OMIT_EMPTY
    )

    def get(self, name: str) -> Derived[Any] | None:
        """Return the result of a name, or None."""
        return getattr(self, name) if name in _names(Results) else self.more.get(name)

    def with_(self, name: str, derived: Derived[Any] | None) -> "Results":
        """Return the results with another one under this name; None: with none."""
        return _with(self, name, derived)


@cache
def _names(kind: type) -> frozenset[str]:
    """Return the names that captures or results have fields for; others stand below ``more``."""
    return frozenset(part.name for part in fields(kind)) - {"more"}


Holder = TypeVar("Holder", Captures, Results)


def _with(holder: Holder, name: str, held: Any) -> Holder:
    if name in _names(type(holder)):
        return replace(holder, **{name: held})
    more = {key: value for key, value in holder.more.items() if key != name}
    if held is not None:
        more[name] = held
    return replace(holder, more=more)


@dataclass(frozen=True, slots=True, eq=False)
class LogEntry:
    """One message as it came in."""

    number: int
    message: str
    arguments: dict[str, object]  # plain values; captures appear as their ordinal and digest
    time_utc: str


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
    painted: PaintedRegions = field(default_factory=PaintedRegions, metadata=OMIT_EMPTY)
    path_edits: PathEdits = field(default_factory=PathEdits)  # of the path of step 5, by hand
    boundary_edits: BoundaryEdits = field(default_factory=BoundaryEdits)  # of A-scans, by hand
    results: Results = field(default_factory=Results)
    archive: tuple[Capture, ...] = ()  # every capture ever taken, undone ones too
    log: tuple[LogEntry, ...] = ()

    def with_setup(self, **parts: Any) -> "Session":
        """Return the session with other parts of its set-up."""
        return replace(self, setup=replace(self.setup, **parts))

    def with_devices(self, **settings: Any) -> "Session":
        """Return the session with other settings of some devices."""
        return self.with_setup(devices=replace(self.setup.devices, **settings))

    def with_capture(self, name: str, held: Any) -> "Session":
        """Return the session with another capture, or strokes, under this name; None: with none."""
        return replace(self, captures=self.captures.with_(name, held))

    def with_result(self, name: str, derived: Derived[Any] | None) -> "Session":
        """Return the session with another result under this name; None: with none."""
        return replace(self, results=self.results.with_(name, derived))

    def __post_init__(self) -> None:
        require(
            len(self.name) <= MAX_NAME,
            f"name must have at most {MAX_NAME} characters, not {len(self.name)}",
        )
        # addresses and file names are made of it
        require(bool(PLAIN_ID.fullmatch(self.id)), f"id must be plain, not {self.id[:60]!r}")
