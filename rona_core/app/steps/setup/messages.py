"""Messages of the set-up."""

from dataclasses import MISSING, dataclass

from rona_core.app.messages.message import Point, message
from rona_core.app.runtime.saving.session_files import FILE_NAME, plain_name
from rona_core.devices.limits import choice, like, limited, number, switch
from rona_core.devices.settings import (
    TOOL_TITLES,
    ContactSettings,
    DeviceSettings,
    PointerKind,
    ProbeSettings,
    RobotSettings,
    TrackerPlace,
    TrackerProfile,
    TrackerSettings,
)
from rona_core.devices.workcell import BOX_NAME, MOST_NAME, RoomBox, Surroundings
from rona_core.devices.world_settings import WorldSettings
from rona_core.session.document import RegionChoice, Setup
from rona_core.session.specimen import BoneChoice, LoadedSkull, Side, SimulatedSkull


@message
class SetSeed:
    """Choose the seed of all that is random: the patient, the placement and every noise."""

    seed: int = like(Setup, "seed", required=True)


@message
class UseSimulatedSkull:
    """Put a simulated skull on the table; the seed decides which patient it is."""

    side: Side = like(SimulatedSkull, "side")


@message
class SetBoneModel(BoneChoice):
    """Choose what the bone on the table is made of: its texture, and whose speed of sound it has.

    Only the virtual probe knows it; what detects the echoes does not.
    """


@message
class SetWorld(WorldSettings):
    """Choose how far the virtual patient and devices are from their stated values.

    Only they know it; what plans, calibrates and detects does not.
    """


@message
class SetRegion(RegionChoice):
    """Choose the disc to be scanned; without a centre RONA chooses one."""


@message
class SetTracker:
    """Choose noise profile, frame rate and faults of the tracker."""

    profile: TrackerProfile = like(TrackerSettings, "profile")
    rate_hz: float = like(TrackerSettings, "rate_hz")
    stereo: bool = like(TrackerSettings, "stereo")
    depth_ratio: float = like(TrackerSettings, "depth_ratio")
    occlusion: bool = like(TrackerSettings, "occlusion")
    phantom_share: float = like(TrackerSettings, "phantom_share")
    latency_ms: float | None = like(TrackerSettings, "latency_ms")
    drift_mm: float = like(TrackerSettings, "drift_mm")
    minutes_on: float = like(TrackerSettings, "minutes_on")
    dropped_share: float = like(TrackerSettings, "dropped_share")


@message
class MoveTracker(TrackerPlace):
    """Move the tracker: shifted from its first place, turned about its vertical there.

    What was recorded stays valid; new strokes are taken from the new place.
    """


@message
class SetUseBaseMarker:
    """Choose whether a tracker that has moved is found again by the marker on the robot base."""

    use_base_marker: bool = like(Setup, "use_base_marker")


@message
class SetToolVisible:
    """Cover a tracked tool up, or uncover it."""

    tool: str = choice(MISSING, "Tool", TOOL_TITLES)
    visible: bool = limited()


@message
class SetRobot:
    """Choose the robot, whether it errs, its scan speed and where its base stands."""

    model: str = like(RobotSettings, "model")
    errors: bool = like(RobotSettings, "errors")
    scan_speed_mm_per_s: float = like(RobotSettings, "scan_speed_mm_per_s")
    base_shift_mm: Point = like(RobotSettings, "base_shift_mm")
    base_turn_deg: float = like(RobotSettings, "base_turn_deg")


@message
class SetProbe(ProbeSettings):
    """Choose the ultrasound probe, its excitation, signal-to-noise ratio and scan pitch."""


@message
class SetPointer:
    """Choose the hand-held pointer: 6D (markers in a plane) or 5D (markers on a line)."""

    kind: PointerKind = like(DeviceSettings, "pointer")


@message
class StartSkullImport:
    """Read a skull from a file that was uploaded before: mask, CT with threshold, or mesh.

    ``label`` is the value of bone in a map of several labels.
    """

    file: str = limited(**FILE_NAME)
    inner_file: str | None = limited(None, **FILE_NAME)
    threshold: float | None = number(
        None, "Bone threshold", "", -1e9, 1e9, 1.0, hint="Grey value, in the units of the file"
    )
    center_mesh_mm: Point | None = like(RegionChoice, "center_mesh_mm")
    radius_mm: float = like(RegionChoice, "radius_mm")
    label: int | None = number(
        None, "Bone label", "", -32_768, 2**31 - 1, 1, hint="Of bone in a map of several labels"
    )

    def __post_init__(self) -> None:
        plain_name(self.file)
        if self.inner_file is not None:
            plain_name(self.inner_file)


@dataclass(frozen=True, slots=True, eq=False)
class StoreSkull:
    """A skull was read from a file: an outcome, which cannot be posted."""

    skull: LoadedSkull


@message
class SetContact(ContactSettings):
    """Choose whether the probe is pressed on with a set force, and the limits of doing so.

    With ``pressed`` false the robot is driven by position alone, and the other fields are idle.
    """

    pressed: bool = switch(True, "Force control", "Off: position control only")


@message
class SetWorkcell:
    """Say where table and floor are and how far the robot keeps from what; boxes stay as they are.

    Table and head follow from the place of work, where the scanned region is put up. A plan that
    was made among other things becomes stale.
    """

    table: bool = like(Surroundings, "table")
    table_center_mm: Point = like(Surroundings, "table_center_mm")
    table_size_mm: Point = like(Surroundings, "table_size_mm")
    floor_mm: float = like(Surroundings, "floor_mm")
    head_below_mm: float = like(Surroundings, "head_below_mm")
    stand_radius_mm: float = like(Surroundings, "stand_radius_mm")
    head_margin_mm: float = like(Surroundings, "head_margin_mm")
    margin_mm: float = like(Surroundings, "margin_mm")
    self_margin_mm: float = like(Surroundings, "self_margin_mm")


@message
class AddObstacle:
    """Add a box that the robot keeps away from, or change the one of this name.

    ``center_mm`` is its middle in the room, ``size_mm`` along its own x, y and z, ``turn_deg``
    about the vertical. ``instead_of`` is the name of the one that it takes the place of, where that
    is to be called otherwise from now on.
    """

    name: str = limited(**{**BOX_NAME, "pattern": r"^\s*\w(?:[\w .()-]*[\w.)])?\s*$"})
    center_mm: Point = like(RoomBox, "center_mm")
    size_mm: Point = like(RoomBox, "size_mm")
    turn_deg: float = like(RoomBox, "turn_deg")
    instead_of: str | None = limited(None, maxLength=MOST_NAME)

    def __post_init__(self) -> None:
        self.box()  # refuses what is no box

    def box(self) -> RoomBox:
        """Return the box."""
        return RoomBox(self.name.strip(), self.center_mm, self.size_mm, self.turn_deg)


@message
class RemoveObstacle:
    """Take a box away again, by its name."""

    name: str = limited(maxLength=MOST_NAME)
