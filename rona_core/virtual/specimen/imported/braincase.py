"""The braincase of a volume: the middle of its cavity and the smooth outer surface about that."""

from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.robust import mad_sigma, reweighted_least_squares, tukey_weights
from rona_core.virtual.specimen.imported.region_choice import GAP_MM
from rona_core.virtual.specimen.imported.volume_reader import BoneVolume

COARSE_MM = 1.5  # blocks in which the volume is looked over
SIDES = 5  # of six, on which a cavity has bone; the spine leaves below
LEAST_CAVITY_MM = 25.0  # radius of a ball in the cavity of a head; a part of one decides nothing
DIRECTIONS = 3000
REACH_MM = 150.0  # from the middle of a head to its surface, at most
DEGREE = 4  # of the smooth surface, in the components of the direction
ROUNDS = 12
LEAST_MM = 1.5  # what the surface is off it for sure
OUTLIER_MM = 25.0  # beyond the median of the surface, where its fit begins
MOST_BLOCKS = 4_000_000


def blocks_of(bone: BoneVolume) -> Ints:
    """Return how many voxels (3,) make a block: small ones, unless they become too many."""
    voxel = bone.voxel_mm()
    blocks = np.maximum(1, np.round(COARSE_MM / voxel)).astype(np.int64)
    while np.prod(np.ceil(np.array(bone.mask.shape) / blocks)) > MOST_BLOCKS:
        blocks[np.argmin(blocks * voxel)] += 1
    return blocks


def cavity_middle(solid: Bools, edge_mm: Floats) -> Floats | None:
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


def directions() -> Floats:
    """Return unit vectors (n, 3), evenly spread over the sphere."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * k / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - z**2)
    return np.stack((flat * np.cos(turn), flat * np.sin(turn), z), axis=1)


def first_exits(solid: Bools, middle: Floats, edge_mm: Floats, rays: Floats) -> Floats:
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


def powers(ways: Floats) -> Floats:
    """Return products (n, k) of the components of directions that span all smooth shapes."""
    columns = [
        np.prod(ways[:, list(which)], axis=1)
        for degree in (DEGREE - 1, DEGREE)
        for which in combinations_with_replacement(range(3), degree)
    ]
    return np.stack(columns, axis=1)


def smooth_surface(ways: Floats, radius: Floats) -> Floats:
    """Return the factors (k,) of the surface over directions (n, 3), outliers left out."""
    design = powers(ways)
    return reweighted_least_squares(
        design,
        radius,
        lambda residuals: tukey_weights(residuals, 4.0 * mad_sigma(residuals, floor=LEAST_MM)),
        rounds=ROUNDS,
        weights=(radius < np.median(radius) + OUTLIER_MM).astype(np.float64),
    )
