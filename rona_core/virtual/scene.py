"""Ground truth of the scene: true poses of robot, tracker, tools and specimen."""

from functools import lru_cache
from typing import TYPE_CHECKING, Protocol

import numpy as np

from rona_core.devices.settings import (
    FIRST_PLACE,
    SONO,
    DeviceSettings,
    RobotSettings,
    TrackerPlace,
)
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import Floats, Ints, Vector3, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.virtual.noise import rng
from rona_core.virtual.pointer_motion import UP
from rona_core.virtual.world.world import NOMINAL, World

if TYPE_CHECKING:
    from rona_core.virtual.specimen.build_specimen import Specimen

# The room, in coordinates of the robot base at its default place. An arm of another reach has head,
# tracker and dimple nearer or further away: see ``region_center``.
REGION_CENTER = (600.0, 60.0, 400.0)
REGION_NORMAL = (-0.15, 0.05, 1.0)
TRACKER_DIRECTION = (0.85, 0.25, 0.46)  # from the region to the tracker: forward, left, above
TRACKER_DISTANCE_MM = 1900.0
DIMPLE = (640.0, 230.0, 360.0)  # a block beside the head that holds a pointer's tip
BASE_MARKER = (370.0, -270.0, 300.0)  # on a bracket of the robot base; it faces the tracker
HEAD_MARKER = (695.0, 0.0, 445.0)  # on a bracket screwed to the bone, on the tracker's side

# Divots on a frame around the head, offsets from the region: as seen from the robot
LANDMARKS = {
    "near left": (-90.0, 170.0, -50.0),
    "near right": (-90.0, -170.0, -50.0),
    "far left": (90.0, 170.0, -50.0),
    "far right": (90.0, -170.0, -50.0),
    "far middle": (170.0, 0.0, -70.0),
}

PLACEMENT_SD = (2.0, np.deg2rad(1.0))  # mm and rad per axis: how exactly people place things
MOUNTING_SD = (1.5, np.deg2rad(0.8))  # likewise, of the marker on the tool
SONO_AXIS_SD_RAD = np.deg2rad(0.8)  # per axis: of the probe's axis against what its maker says
HEAD_WANDER_S, BREATH_S = 240.0, 4.0  # periods
TIP_DEVIATION_MM = (1.0, 3.0)  # how far a pointer's tip is from where its maker says


class TipError(Protocol):
    """How far the robot's tip is from where its encoders say."""

    def Ts_base_tip_true(  # noqa: N802 (frame grammar)
        self, Ts_base_tip_nominal: Poses, qs_rad: Floats | None, ordinal: int, keys: Ints
    ) -> Poses:
        """Return where the tip really is (n,), by commanded motion or time bucket ``keys`` (n,)."""
        ...

    def systematic_mm(self, points_base: Floats, qs_rad: Floats | None = None) -> Floats:
        """Return the repeatable part of the error (n, 3) at points (n, 3), at joints (n, 6)."""
        ...

    def of_motion_mm(self, ordinal: int, key: int) -> Floats:
        """Return the part (3,) that one motion or time bucket ``key`` of a capture has alone."""
        ...


class VirtualScene:
    """True poses and shapes. Devices measure them; only the evaluation may look at them.

    Attributes:
        seed: Seed of the session.
        specimen: The bone, in ``skull``.
        settings: Settings of the devices that it was built with.
        robot_error: Error of the robot.
        world: What patient and devices really are.
        T_base_skull: Pose of the specimen.
        T_base_tracker: Pose of the tracker; its z axis looks at the region.
        T_tip_toolmarker: Mounting of the marker on the tool, as it really is.
        tips: Tip of each pointer (3,) in its marker frame; ``pointer5d`` exactly on its axis.
        dimple_base: Bottom of the dimple (3,) that pointers are pivoted in.
        T_base_basemarker: The marker body on the robot base, as it is really mounted.
        T_base_headmarker: The marker body on the head, while that lies where ``T_base_skull`` says.
        T_sonomarker_probe: The probe in the marker frame of the SonoPointer, z into the bone.
        landmarks_base: Bottoms (3,) of the divots on the frame around the head, by name.
        shafts: Direction (3,) from the tip to the hand of each tool, in its marker frame.
    """

    def __init__(
        self,
        seed: int,
        specimen: "Specimen",
        settings: DeviceSettings,
        *,
        robot_error: TipError,
        T_tip_toolmarker: Pose,
        region_center: tuple[float, float, float] = REGION_CENTER,
        world: World = NOMINAL,
    ) -> None:
        """Place everything.

        Args:
            seed: Seed of the session.
            specimen: The bone, in ``skull``.
            settings: Settings of the devices.
            robot_error: Error of the robot.
            T_tip_toolmarker: Where the tool's maker says the marker sits.
            region_center: Where the head is put up, as it suits the arm: centre of the region in
                coordinates of the base at its default place. The room moves along.
            world: What patient and devices really are.
        """
        self.seed = seed
        self.world = world
        self.specimen = specimen
        self.settings = settings
        self.robot_error = robot_error
        moved = base_displacement(settings.robot)  # from the default place
        generator = rng(seed, "scene", 0, 0)
        region = specimen.region
        placed = _jitter(generator, PLACEMENT_SD) @ Pose(_align(region.normal_skull), np.zeros(3))
        center = np.array(region_center) + generator.normal(0.0, PLACEMENT_SD[0], 3)
        skull = Pose(placed.rotation, center - placed.rotation @ region.center_skull)
        self.T_base_skull = moved.inv() @ skull
        tracker = _looking_at(np.array(region_center), np.array(TRACKER_DIRECTION))
        self._first_tracker = moved.inv() @ tracker @ _jitter(generator, PLACEMENT_SD)
        self._room_axes = moved.rotation.T
        self.T_base_tracker = self.tracker_at(settings.tracker.place)
        self.T_tip_toolmarker = T_tip_toolmarker @ _jitter(generator, MOUNTING_SD)
        self.tips = {
            "pointer6d": _deviated(generator, "pointer6d"),
            "pointer5d": _deviated(generator, "pointer5d"),
        }
        beside = np.array(DIMPLE) - np.array(REGION_CENTER)
        dimple = np.array(region_center) + beside + generator.normal(0.0, PLACEMENT_SD[0], 3)
        self.dimple_base = readonly(moved.inv() @ dimple)
        mounting = _jitter(generator, MOUNTING_SD)  # what is drawn later moves nothing before it
        self.T_base_basemarker = _facing(np.array(BASE_MARKER), tracker.translation) @ mounting
        self.tips[SONO] = _deviated(generator, SONO)
        self.T_sonomarker_probe = _sono_probe(generator, self.tips[SONO])
        on_head = np.array(region_center) + np.array(HEAD_MARKER) - np.array(REGION_CENTER)
        fixed = _facing(on_head, tracker.translation) @ _jitter(generator, MOUNTING_SD)
        self.T_base_headmarker = moved.inv() @ fixed
        frame = np.array(region_center) + generator.normal(0.0, PLACEMENT_SD[0], 3)
        self.landmarks_base = {
            name: readonly(moved.inv() @ (frame + offset)) for name, offset in LANDMARKS.items()
        }
        self.shafts = {tool: UP for tool in ("pointer6d", "pointer5d")}
        self.shafts[SONO] = readonly(-self.T_sonomarker_probe.rotation[:, 2])

    def tracker_at(self, place: TrackerPlace) -> Pose:
        """Return the pose in ``base`` of the tracker when it was put to ``place``."""
        first = self._first_tracker
        if place == FIRST_PLACE:
            return first
        turn = Pose.from_rotvec((0.0, 0.0, np.deg2rad(place.turn_deg)), np.zeros(3)).rotation
        shift_base = self._room_axes @ np.array(place.shift_mm)
        return Pose(turn @ first.rotation, first.translation + shift_base)

    def region_base(self) -> tuple[Vector3, Vector3, float]:
        """Return centre (3,), outward normal (3,) in ``base`` and radius in mm of the region."""
        region = self.specimen.region
        center_base = self.T_base_skull @ region.center_skull
        return center_base, self.T_base_skull.rotate(region.normal_skull), region.radius_mm

    def Ts_base_tip_true(  # noqa: N802 (frame grammar)
        self, Ts_base_tip_nominal: Poses, qs_rad: Floats | None, ordinal: int, keys: Ints
    ) -> Poses:
        """Return where the tip really is (n,) while the encoders say ``Ts_base_tip_nominal``."""
        return self.robot_error.Ts_base_tip_true(Ts_base_tip_nominal, qs_rad, ordinal, keys)

    def head_shift_base(self, ordinal: int, times_s: Floats) -> Floats:
        """Return how far (n, 3) the head is from ``T_base_skull`` at times of a capture.

        It wanders in its clamp over minutes, elsewhere in every capture, and breathes.
        """
        world = self.world
        if world.head_drift_mm == 0.0 and world.breathing_mm == 0.0:
            return np.zeros((len(times_s), 3))
        phases = _head_phases(self.seed, ordinal)
        slow = world.head_drift_mm * np.sin(2.0 * np.pi * times_s / HEAD_WANDER_S + phases[0])
        fast = world.breathing_mm * np.sin(2.0 * np.pi * times_s / BREATH_S + phases[1])
        return (slow + fast)[:, None] * world.head_drift_base


@lru_cache(maxsize=8)  # a contact loop asks every step
def _head_phases(seed: int, ordinal: int) -> Floats:
    """Return the phases (2,) of wandering and breathing in a capture."""
    return readonly(rng(seed, "head", ordinal, 0).uniform(0.0, 2.0 * np.pi, 2))


def base_displacement(settings: RobotSettings) -> Pose:
    """Return the pose of the moved base in the default one: turned about the vertical, shifted."""
    turn = (0.0, 0.0, np.deg2rad(settings.base_turn_deg))
    return Pose.from_rotvec(turn, settings.base_shift_mm)


def _align(normal_skull: Vector3) -> Floats:
    """Return the rotation that turns the region's normal up and the top of the head to the robot.

    The top of the head is +z of ``skull``, or +y where the normal is close to z.
    """
    up = np.array(REGION_NORMAL) / np.linalg.norm(REGION_NORMAL)
    top = np.array((0.0, 0.0, 1.0))
    if abs(normal_skull @ top) > 0.9:
        top = np.array((0.0, 1.0, 0.0))
    source = _frame(normal_skull, top)
    target = _frame(up, np.array((-1.0, 0.0, 0.0)))
    return target @ source.T


def _frame(z: Vector3, towards: Vector3) -> Floats:
    """Return axes (3, 3) as columns: z as given, x as near to ``towards`` as that allows."""
    z = z / np.linalg.norm(z)
    x = towards - (towards @ z) * z
    x = x / np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))


def _looking_at(target: Vector3, direction: Vector3) -> Pose:
    """Return a pose at the tracker's distance from ``target`` whose z axis looks at it."""
    direction = direction / np.linalg.norm(direction)
    level = np.cross(np.array((0.0, 0.0, 1.0)), direction)
    return Pose(_frame(-direction, level), target + TRACKER_DISTANCE_MM * direction)


def _facing(place: Vector3, towards: Vector3) -> Pose:
    """Return a pose at ``place`` whose z axis looks at another place, y as level as it can be."""
    sight = (towards - place) / np.linalg.norm(towards - place)
    return Pose(_frame(sight, np.array((0.0, 0.0, 1.0))), place)


def _jitter(generator: np.random.Generator, sd: tuple[float, float]) -> Pose:
    translation = generator.normal(0.0, sd[0], 3)
    return Pose.from_rotvec(generator.normal(0.0, sd[1], 3), translation)


def _deviated(generator: np.random.Generator, tool: str) -> Vector3:
    geometry = GEOMETRIES[tool]
    length = generator.uniform(*TIP_DEVIATION_MM)
    if geometry.dof == 5:
        direction = np.array((0.0, 0.0, generator.choice((-1.0, 1.0))))
    else:
        direction = generator.normal(0.0, 1.0, 3)
    tip = geometry.nominal_tip_marker + length * direction / np.linalg.norm(direction)
    return readonly(tip)


def _sono_probe(generator: np.random.Generator, face_sonomarker: Vector3) -> Pose:
    """Return the probe in the marker frame of the SonoPointer: its axis nearly along -y."""
    lean = generator.normal(0.0, SONO_AXIS_SD_RAD, 2)
    down = Pose.from_rotvec((0.5 * np.pi, 0.0, 0.0), np.zeros(3)).rotation  # turns z into -y
    leaned = Pose.from_rotvec((lean[0], 0.0, lean[1]), np.zeros(3)).rotation
    return Pose(leaned @ down, face_sonomarker)
