"""Removal of the head holder from a scan: frame, pins, table.

The skull is what surrounds the largest cavity. Seen from the middle of that cavity its outer
surface is smooth; what reaches far beyond it, and what hangs on that, is no skull.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import binary_dilation, label

from rona_core.devices.files.voxels.refusals import refused
from rona_core.geometry.arrays import Bools, Floats, Ints, Vector3
from rona_core.virtual.specimen.imported.braincase import (
    blocks_of,
    cavity_middle,
    directions,
    first_exits,
    powers,
    smooth_surface,
)
from rona_core.virtual.specimen.imported.volume_reader import LEAST_BONE_MM3, BoneVolume, pooled

LOWEST = -0.3  # sine of the elevation: below, the face sticks out of the braincase
NEAR_MM = 10.0  # beyond the surface: maybe no skull
FAR_MM = 50.0  # certainly none: the face of a tilted head, even of a lying one, reaches less far
LEAST_MM3 = 200.0  # beyond it; less is dust
LEAST_MET = 0.5  # share of the rays that meet bone; about a braincase nearly all do
LEAST_KEPT = 0.5  # share of the bone at the surface that is left when the holder is gone
CHUNK = 1 << 17  # blocks
UP = np.array((0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class FreedBone:
    """A skull without what held it."""

    bone: BoneVolume
    cuts_upright: Floats  # (n, 3) where something was cut off; near there the bone is not known

    def require_whole(self, center_upright: Vector3, radius_mm: float) -> None:
        """Raise InvalidInputError if a disc reaches to where something was cut off."""
        off = np.linalg.norm(self.cuts_upright - center_upright, axis=1)
        if len(off) and off.min() < radius_mm + NEAR_MM:
            center = self.bone.T_skull_upright @ center_upright
            raise refused(
                "a disc where the head was held", center=center.round(1).tolist(), off=off.min()
            )


def without_holder(bone: BoneVolume) -> FreedBone:
    """Return the bone without head holder and table, touching or not; all of it if there is none.

    Left as it is: a part of a skull without a cavity, a cavity that is no braincase, and a volume
    of which too little would be left.
    """
    blocks = blocks_of(bone)
    solid = pooled(bone.mask, blocks)
    to_upright = bone.T_upright_voxel @ _affine(blocks, 0.5 * (blocks - 1.0))
    edge_mm = bone.voxel_mm() * blocks
    nothing = FreedBone(bone, np.zeros((0, 3)))
    middle = cavity_middle(solid, edge_mm)
    if middle is None:
        return nothing
    up = np.linalg.inv(to_upright[:3, :3]) @ UP * edge_mm
    up = up / np.linalg.norm(up)
    rays = directions()
    rays = rays[rays @ up > LOWEST]
    radius = first_exits(solid, middle, edge_mm, rays)
    met = np.isfinite(radius)
    if met.mean() < LEAST_MET:
        return nothing
    surface = smooth_surface(rays[met], radius[met])
    beyond, far = _beyond(np.argwhere(solid), middle, edge_mm, up, surface)
    if far.sum() * np.prod(edge_mm) < LEAST_MM3:
        return nothing
    near = np.abs(beyond) < NEAR_MM
    held = _held(solid, beyond, far) if near.any() else solid
    if (~held[solid] & near).sum() < LEAST_KEPT * near.sum() or not near.any():
        return nothing
    mask = _taken_out(bone.mask, held, blocks)
    if np.count_nonzero(mask) * np.prod(bone.voxel_mm()) < LEAST_BONE_MM3:
        return nothing
    cut = _grown(held) & solid & ~held
    cuts = np.argwhere(cut) @ to_upright[:3, :3].T + to_upright[:3, 3]
    return FreedBone(replace(bone, mask=mask), cuts)


def _beyond(
    places: Ints, middle: Floats, edge_mm: Floats, up: Floats, surface: Floats
) -> tuple[Floats, Bools]:
    """Return how far (n,) blocks lie beyond the surface, in mm, and which are no skull for sure.

    Below, the surface goes straight down, and nothing is sure; it may hang on something higher up.
    """
    beyond, far = np.zeros(len(places)), np.zeros(len(places), dtype=np.bool_)
    cosine = np.sqrt(1.0 - LOWEST**2)
    for first in range(0, len(places), CHUNK):  # the powers of all would not fit into memory
        part = slice(first, first + CHUNK)
        offset = (places[part] - middle) * edge_mm
        distance = np.linalg.norm(offset, axis=1)
        ways = offset / np.maximum(distance, 1e-9)[:, None]
        low = ways @ up < LOWEST
        flat = offset - np.outer(offset @ up, up)
        away = np.linalg.norm(flat, axis=1)
        rim = flat / np.maximum(away, 1e-9)[:, None] * cosine + LOWEST * up
        radial = distance - powers(ways) @ surface
        beyond[part] = np.where(low, away - powers(rim) @ surface * cosine, radial)
        far[part] = ~low & (radial > FAR_MM)
    return beyond, far


def _taken_out(mask: Bools, held: Bools, blocks: Ints) -> Bools:
    """Return the voxels (nx, ny, nz) that lie in no held block."""
    mask = mask.copy(order="K")
    nx, ny, nz = mask.shape
    for k in range(nz):  # layer by layer, to spare memory
        gone = np.repeat(np.repeat(held[:, :, k // blocks[2]], blocks[0], 0), blocks[1], 1)
        mask[:, :, k] &= ~gone[:nx, :ny]
    return mask


def _affine(scale: Any, shift: Any) -> Floats:
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = np.diag(scale), shift
    return result


def _held(solid: Bools, beyond: Floats, far: Bools) -> Bools:
    """Return which blocks belong to the holder: far beyond the skull, or hanging on what is.

    Args:
        solid: All blocks with bone.
        beyond: How far (n,) each of these is beyond the surface of the skull.
        far: Which of them (n,) are no skull for certain.
    """
    places = tuple(np.argwhere(solid).T)
    outside, seeds = np.zeros(solid.shape, dtype=np.bool_), np.zeros(solid.shape, dtype=np.bool_)
    outside[places], seeds[places] = beyond > NEAR_MM, far
    held = _touched(outside, seeds)
    # whole pieces that never touched the skull, and the ends that the first cut left over
    pieces = np.zeros(solid.shape, dtype=np.int32)
    label(solid & ~held, output=pieces)
    on_surface = pieces[places][np.abs(beyond) < NEAR_MM]
    skull = int(np.bincount(on_surface[on_surface > 0]).argmax())
    rest = (pieces > 0) & (pieces != skull)
    return held | _touched(rest, _grown(held))


def _grown(region: Bools) -> Bools:
    return np.asarray(binary_dilation(region), dtype=np.bool_)


def _touched(region: Bools, seeds: Bools) -> Bools:
    """Return the pieces of a region that hold a seed."""
    pieces = np.zeros(region.shape, dtype=np.int32)
    count = int(label(region, output=pieces))
    chosen = np.zeros(count + 1, dtype=np.bool_)
    chosen[np.unique(pieces[seeds & region])] = True
    chosen[0] = False
    return chosen[pieces]
