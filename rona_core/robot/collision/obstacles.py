"""What stands around the robot: simple convex shapes in ``base``, each with a margin to keep.

Plain values, so that they can be stored, sent to another process and compared by their digest.
Nothing here knows where things really are: see docs/algorithms/robot/collision.md for who says so.

A head to keep clear of, from what is known: a measured patch, a registered mesh, or a place. A
pointer touches only the patch that is to be scanned. A convex body whose radii of curvature are
nowhere larger than R lies inside the ball of radius R that touches it from outside at any of its
points (Blaschke 1916). So the head lies in the ball that touches the middle of the patch, whatever
part of the head the patch is and whichever way the head lies. See
docs/algorithms/robot/collision.md.
"""

import hashlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError

from rona_core.devices.limits import require
from rona_core.devices.workcell import Surroundings
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import (
    Bools,
    Floats,
    Vector3,
    as_floats,
    as_points,
    as_unit_vectors,
    readonly,
)
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


LARGE_HEAD_MM = (180.0, 230.0, 270.0)  # broad, long, from vertex to chin: larger than adults have
FLATTEST_MM = 205.0  # largest radius of curvature of an ellipsoid of that size: 135 * 135 / 90
MIN_POINTS = 30
MIN_PATCH_MM = 5.0  # root mean square distance from the middle of the patch
DIRECTIONS = 500  # corners of the ball
TOUCH_MM = 5.0  # by which the delay line may reach below the measured surface
STRAY = 4.0  # robust sigmas of a point that belongs to no surface: a tip that was lifted
GOLDEN_RAD = np.pi * (3.0 - np.sqrt(5.0))


def head_from_cloud(points_base: ArrayLike, outward_base: ArrayLike, margin_mm: float) -> Obstacle:
    """Return all that a large head could be under a measured patch.

    Args:
        points_base: Touched points (n, 3) of the outer surface, in ``base``.
        outward_base: Any direction (3,) that points out of the head there.
        margin_mm: How far to keep from it.

    Raises:
        DegenerateGeometryError: too few points, or they do not spread over a patch.
    """
    points = as_points(points_base, name="points_base")
    if len(points) < MIN_POINTS:
        raise DegenerateGeometryError(
            f"{len(points)} points are too few for a head, {MIN_POINTS} are the least"
        )
    middle = points.mean(axis=0)
    spread, axes = np.linalg.svd(points - middle, full_matrices=False)[1:]
    if spread[1] / np.sqrt(len(points)) < MIN_PATCH_MM:
        raise DegenerateGeometryError(
            f"the points lie along a line ({spread[1] / np.sqrt(len(points)):.1f} mm broad): "
            "slide the pointer over a patch"
        )
    outward = as_unit_vectors(np.atleast_2d(outward_base), name="outward_base")[0]
    if axes[2] @ outward < 0.0:
        axes[2] = -axes[2]
    local = (points - middle) @ axes.T
    foot, normal, kept = _middle_of_patch(local)
    ball = foot + FLATTEST_MM * (_sphere() - normal)
    shape = middle + np.vstack((ball, local[kept])) @ axes
    return _head(shape, points[kept], margin_mm)


def head_from_mesh(
    vertices_skull: ArrayLike, T_base_skull: Pose, points_base: ArrayLike, margin_mm: float
) -> Obstacle:
    """Return the convex hull of a registered skull and of what was touched on it.

    Raises:
        DegenerateGeometryError: the vertices enclose nothing.
    """
    vertices = T_base_skull @ as_points(vertices_skull, at_least=4, name="vertices_skull")
    points = as_points(points_base, name="points_base")
    return _head(np.vstack((vertices, points)), points, margin_mm)


def head_as_placed(center_base: ArrayLike, margin_mm: float) -> Obstacle:
    """Return the ball that a large head fills, however it lies: before anything is measured."""
    radius_mm = 0.5 * max(LARGE_HEAD_MM)
    place = Pose.from_translation(center_base)
    return Obstacle(HEAD, Capsule(radius_mm, 0.0), place, margin_mm)


def _head(shape_base: Floats, touched_base: Floats, margin_mm: float) -> Obstacle:
    """Return the hull of some points; the probe may touch as deep in it as what was touched."""
    try:
        hull = ConvexHull(shape_base)
    except QhullError as error:
        raise DegenerateGeometryError("the points of the head enclose nothing") from error
    depth_mm = 0.0
    for part in np.array_split(touched_base, max(1, len(touched_base) // 500)):
        height = part @ hull.equations[:, :3].T + hull.equations[:, 3]
        depth_mm = max(depth_mm, float(-height.max(axis=1).min(initial=0.0)))
    corners = Hull(shape_base[hull.vertices])
    return Obstacle(HEAD, corners, Pose.identity(), margin_mm, depth_mm + TOUCH_MM)


def _middle_of_patch(local: Floats) -> tuple[Vector3, Vector3, Bools]:
    """Return a place (3,) on the surface, its outward normal (3,), and which points (n,) lie on it.

    The height over the plane of the patch is fitted by a quadratic; points far off are left out.
    """
    u, v, w = local.T
    terms = np.stack((np.ones_like(u), u, v, u * u, u * v, v * v), axis=1)
    kept = np.ones(len(u), dtype=np.bool_)
    bend = np.zeros(6)
    for _ in range(3):
        bend = np.linalg.lstsq(terms[kept], w[kept])[0]
        off = np.abs(w - terms @ bend)
        kept = off <= max(STRAY * 1.4826 * float(np.median(off[kept])), 1e-6)
    normal = np.array((-bend[1], -bend[2], 1.0))
    return np.array((0.0, 0.0, bend[0])), normal / np.linalg.norm(normal), kept


def _sphere() -> Floats:
    """Return directions (m, 3) spread evenly."""
    height = 1.0 - 2.0 * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    turn = GOLDEN_RAD * np.arange(DIRECTIONS)
    flat = np.sqrt(1.0 - height * height)
    return np.stack((flat * np.cos(turn), flat * np.sin(turn), height), axis=1)
