"""Bone over a bed while it is milled: the mapped outer boundary, less what the burr has taken."""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.planning.bed import Bed
from rona_core.planning.milling.milling_path import MillingPath
from rona_core.planning.milling.removal import lowest_mm
from rona_core.planning.robot_milling.robot_path import RobotPath

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
