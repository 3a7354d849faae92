"""Which axis of a volume goes up, to a side and to the back of the head, as its bone shows.

The file says how its voxels lie in its coordinates (``mesh``), and by what angle is its own affair:
a grid may be turned as it likes. Which of the voxels' axes goes where is read off the bone where
that is plain, and else off the axes of the file that lie nearest. So the same voxels give the same
skull, wherever and however the file places them.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats, Vector3
from rona_core.virtual.specimen.imported.braincase import (
    REACH_MM,
    blocks_of,
    cavity_middle,
    directions,
    first_exits,
    powers,
    smooth_surface,
)
from rona_core.virtual.specimen.imported.upright_frame import TURNS, upright_frame
from rona_core.virtual.specimen.imported.volume_reader import BoneVolume, pooled

DOME = -0.2  # sine of the elevation down to which a braincase is smooth, seen from its middle
ROUGH_MM = 10.0  # off the smooth surface counts no more than this, nor does a ray without bone
LEAST_MET = 200  # rays, for a surface
UP_SHARE, UP_MM = 0.75, 0.3  # how much smoother the dome must be than any other side
SIDE_SHARE, SIDE_MM = 0.65, 0.4  # how much more alike right and left must be than front and back
FACE_MM = 4.0  # how far the bone below the middle must lie to one side, on average


def stand_as_the_bone_does(bone: BoneVolume) -> BoneVolume:
    """Return the volume with z up, x to a side and y to the back, where the bone shows them.

    Up is where the braincase is smooth; a side is where the mirrored surface is the same one; the
    face is where more of the bone below the cavity lies.
    """
    blocks = blocks_of(bone)
    solid = pooled(bone.mask, blocks)
    edge_mm = bone.voxel_mm() * blocks
    middle = cavity_middle(solid, edge_mm)
    if middle is None:
        return bone
    rays = directions()
    radius = first_exits(solid, middle, edge_mm, rays)
    up = _up(rays, radius)
    if up is None:
        return bone
    turns = [turn for turn in TURNS if (turn[2] == up).all()]
    side = _side(rays, radius, up)
    behind = None
    if side is not None:
        turns = [turn for turn in turns if abs(turn[0, side]) == 1.0]
        forth: Vector3 = np.asarray(np.cross(up, np.eye(3)[side]), dtype=np.float64)
        behind = _behind(solid, middle, edge_mm, up, forth)
        turns = [t for t in turns if behind is None or (t[1] == behind).all()]
    T_upright_voxel, T_skull_upright = upright_frame(bone.T_skull_voxel(), turns)
    along = float(T_skull_upright.rotation[:, 1] @ bone.T_skull_upright.rotation[:, 1])
    return replace(
        bone,
        T_upright_voxel=T_upright_voxel,
        T_skull_upright=T_skull_upright,
        back=round(bone.back * along) if behind is None else 1,
    )


def _roughness_mm(rays: Floats, radius: Floats, axis: Vector3) -> float:
    """Return how far the surface about an axis is off a smooth one, on average."""
    near = rays @ axis > DOME
    met = near & np.isfinite(radius)
    if met.sum() < LEAST_MET:
        return ROUGH_MM
    ways = powers(rays[met])
    factors = smooth_surface(rays[met], radius[met])
    off = np.minimum(np.abs(ways @ factors - radius[met]), ROUGH_MM).sum()
    return float((off + ROUGH_MM * (near.sum() - met.sum())) / near.sum())


def _up(rays: Floats, radius: Floats) -> Vector3 | None:
    """Return the way (3,) along an axis of the voxels about which the bone is a dome, or None."""
    ways = np.concatenate((np.eye(3), -np.eye(3)))
    rough = np.array([_roughness_mm(rays, radius, way) for way in ways])
    best, second = np.sort(rough)[:2]
    plain = best < UP_SHARE * second and best < second - UP_MM
    return ways[int(np.argmin(rough))] if plain else None


def _side(rays: Floats, radius: Floats, up: Vector3) -> int | None:
    """Return the axis of the voxels across which the dome is like its mirror image, or None."""
    tree = KDTree(rays)
    unlike: dict[float, int] = {}
    for axis in np.flatnonzero(up == 0.0):
        mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
        other = radius[tree.query(rays * mirror)[1]]
        seen = (rays @ up > 0.0) & np.isfinite(radius) & np.isfinite(other)
        if seen.sum() < LEAST_MET:
            return None
        off, along = radius[seen] - other[seen], rays[seen, axis]
        off = off - along * (off @ along) / (along @ along)  # the middle is off the plane
        unlike[float(np.median(np.abs(off)))] = int(axis)
    least, most = min(unlike), max(unlike)
    return unlike[least] if least < SIDE_SHARE * most and least < most - SIDE_MM else None


def _behind(
    solid: Bools, middle: Floats, edge_mm: Floats, up: Vector3, forth: Vector3
) -> Vector3 | None:
    """Return the way (3,) away from the face, ``forth`` or against it; None if none is seen."""
    places = (np.argwhere(solid) - middle) * edge_mm
    below = (places @ up < 0.0) & ((places**2).sum(axis=1) < REACH_MM**2)
    mean_mm = float((places[below] @ forth).mean()) if below.any() else 0.0
    return None if abs(mean_mm) < FACE_MM else -np.sign(mean_mm) * forth
