"""What stands around the robot: simple convex shapes in ``base``, each with a margin to keep.

Plain values, so that they can be stored, sent to another process and compared by their digest.
Nothing here knows where things really are: see docs/algorithms/robot/collision.md for who says so.
"""

import hashlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.limits import require
from rona_core.devices.workcell import Surroundings
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, as_floats, as_points, readonly
from rona_core.geometry.pose import Pose

HEAD = "head"
FLAT_MM = 0.5  # a hull thinner than this encloses nothing
DIGEST_DECIMALS = 6  # of mm, and of the components of axes
FLOOR_MM = (12000.0, 12000.0, 100.0)
BAR_MM, BAR_RADIUS_MM = 320.0, 90.0  # half length and radius of the cameras of a tracker


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """The convex hull of points (n, 3), in the frame of the obstacle."""

    vertices: Floats

    def __post_init__(self) -> None:
        points = as_points(self.vertices, at_least=4, name="vertices of a hull")
        thickness = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[2]
        if thickness / np.sqrt(len(points)) < FLAT_MM:
            raise DegenerateGeometryError(
                f"{len(points)} points of a hull lie nearly in a plane: they enclose nothing"
            )
        object.__setattr__(self, "vertices", readonly(points))


@dataclass(frozen=True, slots=True)
class Box:
    """A box about the origin of the obstacle."""

    size_mm: tuple[float, float, float]

    def __post_init__(self) -> None:
        require(min(self.size_mm) > 0.0, f"size_mm must be positive, not {self.size_mm}")


@dataclass(frozen=True, slots=True)
class Capsule:
    """All places within a radius of a segment along z, centred on the origin of the obstacle."""

    radius_mm: float
    length_mm: float  # of the segment; 0 makes a ball

    def __post_init__(self) -> None:
        require(
            self.radius_mm > 0.0 and self.length_mm >= 0.0,
            f"a capsule needs a radius, not {self.radius_mm} mm by {self.length_mm} mm",
        )


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """One thing to keep away from."""

    name: str
    shape: Hull | Box | Capsule
    pose: Pose  # of the shape in ``base``
    margin_mm: float
    touch_mm: float = 0.0  # how far the delay line of the probe may reach into it; 0: not at all

    def __post_init__(self) -> None:
        require(0.0 <= self.margin_mm <= 1000.0, f"margin_mm must be 0 to 1000: {self.margin_mm}")
        require(0.0 <= self.touch_mm <= 100.0, f"touch_mm must be 0 to 100: {self.touch_mm}")


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """Everything around the robot, and how far its own parts keep from each other."""

    things: tuple[Obstacle, ...]
    self_margin_mm: float = 5.0
    sentence: str = ""  # where the head comes from, and what is assumed

    def __post_init__(self) -> None:
        names = [thing.name for thing in self.things]
        require(len(set(names)) == len(names), f"obstacles need names of their own: {names}")
        require(0.0 <= self.self_margin_mm <= 1000.0, "self_margin_mm must be 0 to 1000")

    def without_touch(self) -> "Obstacles":
        """Return the same things for a robot that is to keep its distance, delay line included."""
        things = tuple(replace(thing, touch_mm=0.0) for thing in self.things)
        return replace(self, things=things)

    def digest(self) -> str:
        """Return the SHA-256 of all shapes, places and margins, as hexadecimal digits.

        They count to the nanometre: the last bits depend on the processor that computed them.
        """
        hasher = hashlib.sha256()
        for thing in self.things:
            pose = thing.pose
            distances = (thing.margin_mm, thing.touch_mm)
            numbers = (_numbers(thing.shape), pose.rotation, pose.translation, distances)
            hasher.update(f"{thing.name}\n{type(thing.shape).__name__}\n".encode())
            for values in numbers:
                exact = np.ascontiguousarray(values, dtype="<f8")
                exact = np.round(exact, DIGEST_DECIMALS) + 0.0  # no negative zero
                hasher.update(f"{exact.shape}".encode() + exact.tobytes())
        hasher.update(np.float64(self.self_margin_mm).tobytes())
        return hasher.hexdigest()


def _numbers(shape: Hull | Box | Capsule) -> Floats:
    if isinstance(shape, Hull):
        return shape.vertices
    if isinstance(shape, Box):
        return np.array(shape.size_mm)
    return np.array((shape.radius_mm, shape.length_mm))


NOTHING_AROUND = Obstacles(())  # the robot alone: it can still meet itself


def capsule_between(
    name: str, start_base: ArrayLike, end_base: ArrayLike, radius_mm: float, margin_mm: float
) -> Obstacle:
    """Return a capsule about the segment from one place (3,) to another."""
    start, end = as_floats(start_base), as_floats(end_base)
    way = end - start
    length_mm = float(np.linalg.norm(way))
    z = way / length_mm if length_mm > 0.0 else np.array((0.0, 0.0, 1.0))
    across: Floats = np.linalg.svd(z[None])[2][1]
    pose = Pose(np.column_stack((across, np.cross(z, across), z)), 0.5 * (start + end))
    return Obstacle(name, Capsule(radius_mm, length_mm), pose, margin_mm)


def table_and_floor(
    settings: Surroundings, room: Pose, work_room: ArrayLike
) -> tuple[Obstacle, ...]:
    """Return table and floor where the set-up says they are.

    Args:
        settings: What was said.
        room: Pose of the room in ``base``.
        work_room: The place of work (3,) in the room.
    """
    top = np.asarray(work_room) + np.array(settings.table_center_mm)
    middle = Pose.from_translation(top - (0.0, 0.0, 0.5 * settings.table_size_mm[2]))
    table = Obstacle("table", Box(settings.table_size_mm), room @ middle, settings.margin_mm)
    ground = Pose.from_translation((0.0, 0.0, settings.floor_mm - 0.5 * FLOOR_MM[2]))
    floor = Obstacle("floor", Box(FLOOR_MM), room @ ground, settings.margin_mm)
    return (table, floor) if settings.table else (floor,)


def added_boxes(settings: Surroundings, room: Pose) -> tuple[Obstacle, ...]:
    """Return the further boxes of the set-up, in ``base``."""
    return tuple(
        Obstacle(
            box.name,
            Box(box.size_mm),
            room @ Pose.from_rotvec((0.0, 0.0, np.deg2rad(box.turn_deg)), box.center_mm),
            settings.margin_mm,
        )
        for box in settings.boxes
    )


def tracker_stand(settings: Surroundings, T_base_tracker: Pose) -> tuple[Obstacle, ...]:
    """Return the cameras of a registered tracker, along its x axis, and the pole beneath them."""
    eye = T_base_tracker.translation
    foot = np.array((eye[0], eye[1], min(settings.floor_mm, eye[2])))
    half = BAR_MM * T_base_tracker.rotation[:, 0]
    keep = settings.margin_mm
    return (
        capsule_between("tracker", eye - half, eye + half, BAR_RADIUS_MM, keep),
        capsule_between("tracker stand", foot, eye, settings.stand_radius_mm, keep),
    )
