"""The milling path of a bed as a robot drives it, and the bone over the bed meanwhile."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.planning.bed import Bed
from rona_core.planning.milling.milling_path import MillingPath, Move
from rona_core.planning.milling.removal import lowest_mm
from rona_core.robot.collision.obstacles import Capsule, Hull, Obstacle, Obstacles
from rona_core.robot.trajectory.trajectory import CuttingPath

# Beyond the deepest place of the burr, so that no distance of its body decides: that it never goes
# below its path is looked at by itself, and closer.
REACH_IN_MM = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class RobotPath:
    """What the burr is to follow, and which place of the milling path each move leads to."""

    cutting: CuttingPath  # of m places
    places: Ints  # (m,) place of the milling path; at a rest the one before it, at first 0


def robot_path(
    path: MillingPath, feeds_mm_per_s: Floats, T_base_bed: Pose, surface_mm: float
) -> RobotPath:
    """Return what a robot is to drive: each layer begins and ends at rest above the middle.

    Upright in the air, as high as the path itself goes up between cuts. So the end of every layer
    is the same posture, and a motion that stops there returns as after the last one.

    Args:
        path: Of n places.
        feeds_mm_per_s: Feeds (n,) of its moves.
        T_base_bed: Where the bed lies.
        surface_mm: How far the bone within the outline rises above z = 0.

    Raises:
        InvalidInputError: a layer that does not begin and end in the air, or a burr that is no
            ball.
    """
    require(all(burr.is_ball for burr in path.burrs), "the robot mills with balls alone")
    bottoms, n = path.bottoms_bed(), len(path)
    ends = np.append(np.flatnonzero(np.diff(path.layers)), n - 1)
    starts = np.append(0, ends[:-1] + 1)
    high = np.minimum(bottoms[starts, 2], bottoms[ends, 2])
    up = (path.moves[starts] == Move.RETRACT) & (path.moves[ends] == Move.RETRACT)
    require(
        bool(up.all() and (high > surface_mm).all()),
        "every layer of a milling path must begin and end in the air",
    )
    rest = (0.0, 0.0, float(high.min()))
    before = np.append(starts, n)  # where rests are put in
    radii = np.array([burr.radius_mm for burr in path.burrs])[path.tools]
    air = float(feeds_mm_per_s[path.moves == Move.RETRACT].max())
    cutting = CuttingPath(
        T_base_bed=T_base_bed,
        bottoms_bed=np.insert(bottoms, before, rest, axis=0),
        axes_bed=np.insert(path.axes_bed, before, (0.0, 0.0, -1.0), axis=0),
        radii_mm=np.insert(radii, before, radii[np.append(0, ends)]),
        feeds_mm_per_s=np.insert(feeds_mm_per_s, before, air),
        in_air=np.insert(path.moves == Move.RETRACT, before, values=True),
        rests=readonly(before + np.arange(len(before))),
        surface_mm=surface_mm,
    )
    places = np.insert(np.arange(n), before, np.append(0, ends))
    return RobotPath(cutting, readonly(places.astype(np.int64)))


def milling_obstacles(obstacles: Obstacles, path: CuttingPath) -> Obstacles:
    """Return what the robot keeps away from while it mills: the burr may enter as deep as planned.

    Into everything that may be touched, which is the head; nothing else of the robot may.
    """
    bottoms_base = path.T_base_bed @ path.bottoms_bed
    things = tuple(
        replace(thing, touch_mm=max(_depth_mm(thing, bottoms_base), 0.0) + REACH_IN_MM)
        if thing.touch_mm
        else thing
        for thing in obstacles.things
    )
    return replace(obstacles, things=things)


def _depth_mm(thing: Obstacle, points_base: Floats) -> float:
    """Return how deep the deepest of some points (n, 3) lies below the surface of a thing."""
    points = thing.pose.inv() @ points_base
    if isinstance(thing.shape, Capsule):
        half = 0.5 * thing.shape.length_mm
        along = np.clip(points[:, 2], -half, half)[:, None] * (0.0, 0.0, 1.0)
        return float((thing.shape.radius_mm - np.linalg.norm(points - along, axis=1)).max())
    if isinstance(thing.shape, Hull):
        # the deepest is as deep below a hull as below the nearest of its planes; plane by plane, as
        # all pairs together are a hundred megabytes
        above = np.full(len(points), -np.inf)
        for *normal, offset in np.unique(ConvexHull(thing.shape.vertices).equations, axis=0):
            np.maximum(above, points @ np.array(normal) + offset, out=above)
        return float(-above.min())
    half_sizes = 0.5 * np.array(thing.shape.size_mm)
    return float((half_sizes - np.abs(points)).min(axis=1).max())


CELL_MM = 0.4
AROUND_MM = 2.0  # of the bed; more than a cell of the maps, so that both surfaces meet
TURNS = 3  # until a height in the leaning frame of the bed is found


@dataclass(frozen=True, slots=True, eq=False)
class BoneOverBed:
    """Surface of the bone over a bed as it was mapped, and how low the burr comes, in ``bed``."""

    x_mm: Floats  # (nx,) evenly spaced
    y_mm: Floats  # (ny,)
    surface_mm: Floats  # (nx, ny) of the outer boundary
    ok: Bools  # (nx, ny) it is mapped there
    lowest_mm: Floats  # (layers + 1, nx, ny) before the first layer, and after each; else infinity


def bone_over(bed: Bed, path: MillingPath, T_base_bed: Pose, outer: BoundaryMap) -> BoneOverBed:
    """Return the bone over a bed, and what each layer of its milling takes."""
    x_mm, y_mm = (
        readonly(np.arange(along[0] - AROUND_MM, along[-1] + AROUND_MM, CELL_MM))
        for along in (bed.x_mm, bed.y_mm)
    )
    x, y = np.meshgrid(x_mm, y_mm, indexing="ij")
    T_map_bed: Pose = outer.T_base_map.inv() @ T_base_bed
    z = np.zeros(x.shape)
    points_map = T_map_bed @ np.stack((x, y, z), axis=-1).reshape(-1, 3)
    for _ in range(TURNS):
        z -= (points_map[:, 2] - outer.heights(points_map)).reshape(x.shape)
        points_map = T_map_bed @ np.stack((x, y, z), axis=-1).reshape(-1, 3)
    lowest = [np.full(x.shape, np.inf)]
    for layer in range(int(path.layers[-1]) + 1):
        first, end = np.searchsorted(path.layers, (layer, layer + 1))
        taken = lowest_mm(path.part(max(int(first) - 1, 0), int(end)), x_mm, y_mm)
        lowest.append(np.minimum(lowest[-1], taken))
    return BoneOverBed(
        x_mm,
        y_mm,
        readonly(z),
        readonly(outer.mapped_share(points_map).reshape(x.shape) > 0.99),
        readonly(np.stack(lowest)),
    )


def bone_left(bone: BoneOverBed, path: MillingPath, robot: RobotPath, way_mm: float) -> Floats:
    """Return how high the bone is (nx, ny) in ``bed`` so far along the path of the robot."""
    layer, part = _so_far(path, robot, way_mm)
    lowest = np.minimum(bone.lowest_mm[layer], lowest_mm(part, bone.x_mm, bone.y_mm))
    return np.minimum(bone.surface_mm, lowest)


def _so_far(path: MillingPath, robot: RobotPath, way_mm: float) -> tuple[int, MillingPath]:
    """Return how many layers are done at a way of the robot's path, and what of the next one is."""
    move = int(robot.cutting.moves_at(np.array((way_mm,)))[0])
    place = int(robot.places[move])
    passed = place + (move in robot.cutting.rests)  # a rest is put in after the place it follows
    layer = int(path.layers[place])
    first = max(int(np.searchsorted(path.layers, layer)) - 1, 0)
    now = robot.cutting.at(np.array((way_mm,)))
    here = replace(path.part(place, place + 1), tips_bed=now.tips_bed, axes_bed=now.axes_bed)
    before = path.part(first, passed) if passed > first else None
    return layer, here if before is None else before.followed_by(here)
