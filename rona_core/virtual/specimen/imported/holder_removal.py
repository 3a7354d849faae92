"""Removal of the head holder from a scan: frame, pins, table.

The skull is what surrounds the largest cavity. Seen from the middle of that cavity its outer
surface is smooth; what reaches far beyond it, and what hangs on that, is no skull.
"""

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, Vector3
from rona_core.geometry.robust import mad_sigma, reweighted_least_squares, tukey_weights
from rona_core.virtual.specimen.imported.region_choice import GAP_MM
from rona_core.virtual.specimen.imported.volume_reader import LEAST_BONE_MM3, BoneVolume, pooled

COARSE_MM = 1.5  # blocks in which the volume is looked over
SIDES = 5  # of six, on which a cavity has bone; the spine leaves below
LEAST_CAVITY_MM = 25.0  # radius of a ball in the cavity of a head; a part of one decides nothing
DIRECTIONS = 3000
LOWEST = -0.3  # sine of the elevation: below, the face sticks out of the braincase
REACH_MM = 150.0  # from the middle of a head to its surface, at most
DEGREE = 4  # of the smooth surface, in the components of the direction
ROUNDS = 12
LEAST_MM = 1.5  # what the surface is off it for sure
NEAR_MM = 10.0  # beyond the surface: maybe no skull
FAR_MM = 50.0  # certainly none: the face of a tilted head, even of a lying one, reaches less far
OUTLIER_MM = 25.0  # beyond the median of the surface, where its fit begins
LEAST_MM3 = 200.0  # beyond it; less is dust
LEAST_MET = 0.5  # share of the rays that meet bone; about a braincase nearly all do
LEAST_KEPT = 0.5  # share of the bone at the surface that is left when the holder is gone
MOST_BLOCKS = 4_000_000
CHUNK = 1 << 17  # blocks
UP = np.array((0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class FreedBone:
    """A skull without what held it."""

    bone: BoneVolume
    cuts_skull: Floats  # (n, 3) where something was cut off; near there the bone is not known

    def require_whole(self, center_skull: Vector3, radius_mm: float) -> None:
        """Raise InvalidInputError if a disc reaches to where something was cut off."""
        off = np.linalg.norm(self.cuts_skull - center_skull, axis=1)
        if len(off) and off.min() < radius_mm + NEAR_MM:
            raise InvalidInputError(
                f"the disc about {center_skull.round(1).tolist()} reaches to where the head was "
                f"held, {off.min():.0f} mm from its centre: choose a centre farther from that, or "
                f"take the holder out of the file"
            )


def without_holder(bone: BoneVolume) -> FreedBone:
    """Return the bone without head holder and table, touching or not; all of it if there is none.

    Left as it is: a part of a skull without a cavity, a cavity that is no braincase, and a volume
    of which too little would be left.
    """
    blocks = _blocks(bone)
    solid = pooled(bone.mask, blocks)
    to_skull = bone.T_skull_voxel @ _affine(blocks, 0.5 * (blocks - 1.0))
    edge_mm = bone.voxel_mm() * blocks
    nothing = FreedBone(bone, np.zeros((0, 3)))
    middle = _middle(solid, edge_mm)
    if middle is None:
        return nothing
    up = np.linalg.inv(to_skull[:3, :3]) @ UP * edge_mm
    up = up / np.linalg.norm(up)
    rays = _directions(up)
    radius = _first_exits(solid, middle, edge_mm, rays)
    met = np.isfinite(radius)
    if met.mean() < LEAST_MET:
        return nothing
    surface = _smooth_surface(rays[met], radius[met])
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
    cuts = np.argwhere(cut) @ to_skull[:3, :3].T + to_skull[:3, 3]
    return FreedBone(replace(bone, mask=mask), cuts)


def _blocks(bone: BoneVolume) -> Ints:
    """Return how many voxels (3,) make a block: small ones, unless they become too many."""
    voxel = bone.voxel_mm()
    blocks = np.maximum(1, np.round(COARSE_MM / voxel)).astype(np.int64)
    while np.prod(np.ceil(np.array(bone.mask.shape) / blocks)) > MOST_BLOCKS:
        blocks[np.argmin(blocks * voxel)] += 1
    return blocks


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
        radial = distance - _powers(ways) @ surface
        beyond[part] = np.where(low, away - _powers(rim) @ surface * cosine, radial)
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


def _middle(solid: Bools, edge_mm: Floats) -> Floats | None:
    """Return the middle (3,) of the largest ball in a cavity, as an index; None without one."""
    hit = np.zeros(solid.shape, dtype=np.int8)
    for axis in range(3):
        hit += np.logical_or.accumulate(solid, axis=axis)
        hit += np.flip(np.logical_or.accumulate(np.flip(solid, axis), axis=axis), axis)
    cavity = ~solid & (hit >= SIDES)
    if not cavity.any():
        return None
    # what has bone on five sides lies in the box about all bone, and so does the nearest bone
    ends = [np.flatnonzero(solid.any(axis=axes))[[0, -1]] for axes in ((1, 2), (0, 2), (0, 1))]
    box = tuple(slice(first, last + 1) for first, last in ends)
    depth: Any = distance_transform_edt(~solid[box], sampling=edge_mm)
    depth = np.where(cavity[box], depth, 0.0)
    if depth.max() < LEAST_CAVITY_MM:
        return None
    deepest = np.unravel_index(int(depth.argmax()), depth.shape)
    return np.array(deepest, dtype=np.float64) + [first for first, _ in ends]


def _directions(up: Floats) -> Floats:
    """Return unit vectors (n, 3), evenly spread, none far below the horizon."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * k / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - z**2)
    rays = np.stack((flat * np.cos(turn), flat * np.sin(turn), z), axis=1)
    return rays[rays @ up > LOWEST]


def _first_exits(solid: Bools, middle: Floats, edge_mm: Floats, rays: Floats) -> Floats:
    """Return how far (n,) the first bone reaches along rays, gaps of air cells bridged.

    Infinite where there is none.
    """
    step = 0.5 * float(edge_mm.min())
    t = np.arange(step, REACH_MM, step)
    places = np.rint(middle + t[None, :, None] * rays[:, None, :] / edge_mm).astype(np.int64)
    inside = (places >= 0) & (places < np.array(solid.shape))
    there: Bools = np.asarray(inside.all(axis=2), dtype=np.bool_)
    x, y, z = np.moveaxis(np.where(there[..., None], places, 0), 2, 0)
    bone = solid[x, y, z] & there
    gap = max(1, round(GAP_MM / step))
    # how many samples ago bone was met last, once it has been met
    index = np.arange(len(t))
    last = np.maximum.accumulate(np.where(bone, index, -1), axis=1)
    ended = (last >= 0) & (index - last >= gap)
    first = np.where(ended.any(axis=1), np.argmax(ended, axis=1), len(t) - 1)
    exits = last[np.arange(len(rays)), first]
    return np.where(exits >= 0, t[np.clip(exits, 0, None)], np.inf)


def _powers(ways: Floats) -> Floats:
    """Return products (n, k) of the components of directions that span all smooth shapes."""
    columns = [
        np.prod(ways[:, list(which)], axis=1)
        for degree in (DEGREE - 1, DEGREE)
        for which in combinations_with_replacement(range(3), degree)
    ]
    return np.stack(columns, axis=1)


def _smooth_surface(ways: Floats, radius: Floats) -> Floats:
    """Return the factors (k,) of the surface over directions (n, 3), outliers left out."""
    design = _powers(ways)
    return reweighted_least_squares(
        design,
        radius,
        lambda residuals: tukey_weights(residuals, 4.0 * mad_sigma(residuals, floor=LEAST_MM)),
        rounds=ROUNDS,
        weights=(radius < np.median(radius) + OUTLIER_MM).astype(np.float64),
    )


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
    count = int(label(region, output=pieces))  # pyright: ignore[reportArgumentType]
    chosen = np.zeros(count + 1, dtype=np.bool_)
    chosen[np.unique(pieces[seeds & region])] = True
    chosen[0] = False
    return chosen[pieces]
