"""Messages of the set-up."""

from dataclasses import dataclass
from typing import Literal

from rona_core.app.messages.message import Point, message, values_of
from rona_core.app.runtime.saving.session_files import plain_name
from rona_core.devices.settings import (
    TOOLS,
    ContactSettings,
    PointerKind,
    ProbeSettings,
    TrackerPlace,
    TrackerProfile,
    require,
)
from rona_core.devices.workcell import RoomBox, Surroundings
from rona_core.devices.world_settings import WorldSettings
from rona_core.session.document import RegionChoice, require_seed
from rona_core.session.specimen import BoneChoice, LoadedSkull

STANDARD = Surroundings()


@message
class SetSeed:
    """Choose the seed of all that is random: the patient, the placement and every noise."""

    seed: int

    def __post_init__(self) -> None:
        require_seed(self.seed)


@message
class UseSimulatedSkull:
    """Put a simulated skull on the table; the seed decides which patient it is."""

    side: Literal["left", "right"] = "left"


@message
class SetBoneModel(BoneChoice):
    """Choose what the bone on the table is made of: its texture, and whose speed of sound it has.

    Only the virtual probe knows it; what detects the echoes does not.
    """


@message
class SetWorld(WorldSettings):
    """Choose how far the virtual patient and devices are from what is told of them.

    Only they know it; what plans, calibrates and detects does not.
    """


@message
class SetRegion(RegionChoice):
    """Choose the disc to be scanned; without a centre RONA chooses one."""


@message
class SetTracker:
    """Choose noise profile, frame rate and faults of the tracker."""

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


@message
class MoveTracker(TrackerPlace):
    """Move the tracker: shifted from its first place, turned about its vertical there.

    What was recorded stays valid; new strokes are taken from the new place.
    """


@message
class SetUseBaseMarker:
    """Choose whether a tracker that has moved is found again by the marker on the robot base."""

    use_base_marker: bool = True


@message
class SetToolVisible:
    """Cover a tracked tool up, or uncover it."""

    tool: str
    visible: bool

    def __post_init__(self) -> None:
        require(self.tool in TOOLS, f"tool must be one of {', '.join(TOOLS)}, not {self.tool!r}")


@message
class SetRobot:
    """Choose the robot, whether it errs, its scan speed and where its base stands."""

    model: str = "rx90"
    errors: bool = True
    scan_speed_mm_per_s: float = 20.0
    base_shift_mm: Point = (0.0, 0.0, 0.0)
    base_turn_deg: float = 0.0


@message
class SetProbe(ProbeSettings):
    """Choose the ultrasound probe, its excitation, signal-to-noise ratio and scan pitch."""


@message
class SetPointer:
    """Choose the hand-held pointer: 6D (markers in a plane) or 5D (markers on a line)."""

    kind: PointerKind = "pointer6d"


@message
class StartSkullImport:
    """Read a skull from a file that was uploaded before: mask, CT with threshold, or mesh.

    ``label`` is the value of bone in a map of several labels.
    """

    file: str
    inner_file: str | None = None
    threshold: float | None = None
    center_mesh_mm: Point | None = None
    radius_mm: float = 25.0
    label: int | None = None

    def __post_init__(self) -> None:
        plain_name(self.file)
        if self.inner_file is not None:
            plain_name(self.inner_file)
        RegionChoice(self.center_mesh_mm, self.radius_mm)  # refuses what is no region


@dataclass(frozen=True, slots=True, eq=False)
class StoreSkull:
    """A skull was read from a file: an outcome, which nobody can post."""

    skull: LoadedSkull


@message
class SetContact(ContactSettings):
    """Choose whether the probe is pressed on with a set force, and the limits of doing so.

    With ``pressed`` false the robot is driven by position alone, and the other fields are idle.
    """

    pressed: bool = True


@message
class SetWorkcell:
    """Say where table and floor are and how far the robot keeps from what; boxes stay as they are.

    Table and head are told from the place of work, where the scanned region is put up. A plan that
    was made among other things becomes stale.
    """

    table: bool = STANDARD.table
    table_center_mm: Point = STANDARD.table_center_mm  # middle of the top
    table_size_mm: Point = STANDARD.table_size_mm  # along x, along y, thickness
    floor_mm: float = STANDARD.floor_mm
    head_below_mm: float = STANDARD.head_below_mm
    stand_radius_mm: float = STANDARD.stand_radius_mm
    head_margin_mm: float = STANDARD.head_margin_mm
    margin_mm: float = STANDARD.margin_mm
    self_margin_mm: float = STANDARD.self_margin_mm

    def __post_init__(self) -> None:
        Surroundings(**values_of(self, type(self)))  # refuses what is out of range


@message
class AddObstacle:
    """Add a box that the robot keeps away from, or change the one of this name.

    ``center_mm`` is its middle in the room, ``size_mm`` along its own x, y and z, ``turn_deg``
    about the vertical. ``instead_of`` is the name of the one that it takes the place of, where that
    is to be called otherwise from now on.
    """

    name: str
    center_mm: Point
    size_mm: Point
    turn_deg: float = 0.0
    instead_of: str | None = None

    def __post_init__(self) -> None:
        self.box()  # refuses what is no box

    def box(self) -> RoomBox:
        """Return the box."""
        return RoomBox(self.name.strip(), self.center_mm, self.size_mm, self.turn_deg)


@message
class RemoveObstacle:
    """Take a box away again, by its name."""

    name: str
