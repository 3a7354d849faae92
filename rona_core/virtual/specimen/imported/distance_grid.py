"""Signed distance to bone on a grid about the scanned disc: negative in bone, in mm."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    distance_transform_edt,
    gaussian_filter,
    map_coordinates,
)

from rona_core.geometry.arrays import Bools, Floats, Ints, Vector3
from rona_core.virtual.specimen.imported.mesh_reader import BoneMesh, distance_to, inside
from rona_core.virtual.specimen.imported.region_choice import large_pieces
from rona_core.virtual.specimen.imported.volume_reader import BoneVolume, pooled

SPACING_MM = 0.8
LATERAL_MM = 25.0  # beyond the radius of the disc
ABOVE_MM, BELOW_MM = 12.0, 46.0  # the surface at the centre of the disc, at least
AIR_MM = 6.0  # over the highest bone: rays must start outside it
MOST_ABOVE_MM = 40.0  # bone that rises more is none that a scan comes to
BAND_MM = 4.0  # the distance is clipped to this
SMOOTHING_VOXELS = 1.0  # sigma of the Gaussian that removes the steps of the voxels
MOST_LABELLED = (
    30_000_000  # voxels in which connected pieces are labelled; more are pooled for that
)
MOST_CUBE_VOXELS = 8_000_000  # whose distance is taken at once, at some 30 bytes each
MARGIN_MM = 6.0  # of the volume read around the grid


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """A cubic grid; node (i, j, k) lies at ``origin + spacing * axes @ (i, j, k)``."""

    origin_upright: Vector3
    axes_upright: Floats  # (3, 3), columns
    spacing_mm: float
    shape: tuple[int, int, int]

    def nodes(self) -> Floats:
        """Return all nodes (n, 3) in ``upright``, in C order."""
        index = np.stack(np.meshgrid(*map(np.arange, self.shape), indexing="ij"), axis=-1)
        places = self.spacing_mm * index.reshape(-1, 3).astype(np.float64)
        return self.origin_upright + places @ self.axes_upright.T


def grid_about(center_upright: Vector3, outward_upright: Vector3, radius_mm: float) -> Grid:
    """Return the grid that holds whatever a scan of a disc can touch; its third axis is outward."""
    across: Floats = np.linalg.svd(outward_upright[None])[2][1:]
    axes: Any = np.stack((across[0], np.cross(outward_upright, across[0]), outward_upright), axis=1)
    n = 2 * int(np.ceil((radius_mm + LATERAL_MM) / SPACING_MM)) + 1
    below, above = int(np.ceil(BELOW_MM / SPACING_MM)), int(np.ceil(ABOVE_MM / SPACING_MM))
    start = np.array(((n - 1) / 2, (n - 1) / 2, below))
    origin = center_upright - SPACING_MM * axes @ start
    return Grid(origin, axes, SPACING_MM, (n, n, below + above + 1))


def raised(grid: Grid, highest_mm: float) -> Grid:
    """Return a grid that reaches over bone so far above the centre of its disc, within limits."""
    layers = int(np.ceil((min(highest_mm, MOST_ABOVE_MM) + AIR_MM - ABOVE_MM) / SPACING_MM))
    nx, ny, nz = grid.shape
    return replace(grid, shape=(nx, ny, nz + max(layers, 0)))


def distance_from_volume(bone: BoneVolume, grid: Grid) -> tuple[Floats, float]:
    """Return the smoothed distance on the grid, and the sigma of the smoothing in mm.

    The exact distance between voxel centres, half a voxel taken off on either side, has its zero
    level midway between bone and air voxels; the Gaussian takes out their steps. Cube by cube of
    voxels: a box about a whole slanted grid of fine voxels would not fit into memory.
    """
    to_index = np.linalg.inv(bone.T_upright_voxel)
    places = grid.nodes() @ to_index[:3, :3].T + to_index[:3, 3]
    result = np.zeros(len(places))
    for nodes in _cubes(places, bone):
        result[nodes] = _distance_at(bone, places[nodes])
    return result.reshape(grid.shape), SMOOTHING_VOXELS * float(bone.voxel_mm().mean())


def _cubes(places: Floats, bone: BoneVolume) -> list[Ints]:
    """Return the numbers of the nodes at places (n, 3) in each cube of voxels that holds some.

    The cubes lie along the voxels, even about a grid that is slanted: so few voxels lie in two.
    """
    voxel = bone.voxel_mm()
    widest = np.cbrt(MOST_CUBE_VOXELS * np.prod(voxel)) - 2.0 * MARGIN_MM
    low = places.min(axis=0)
    span = (places.max(axis=0) - low) * voxel
    counts = np.ceil(span / max(widest, MARGIN_MM)).astype(np.int64)
    which = np.minimum((places - low) * voxel / span * counts, counts - 1).astype(np.int64)
    number: Ints = np.asarray(np.ravel_multi_index(tuple(which.T), tuple(counts.tolist())))
    order = np.argsort(number, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1)


def _box(places: Floats, bone: BoneVolume) -> tuple[Ints, Ints]:
    """Return the first and the end (3,) of the voxels about places; some lie off the volume."""
    margin = np.ceil(MARGIN_MM / bone.voxel_mm())
    low = np.floor(places.min(axis=0) - margin)
    high = np.ceil(places.max(axis=0) + margin) + 1
    return low.astype(np.int64), high.astype(np.int64)


def without_small_pieces(bone: BoneVolume, grid: Grid) -> BoneVolume:
    """Return the bone without pieces near the grid that are small beside the largest one there.

    Where more voxels lie about the grid than pieces can be labelled in, blocks of voxels are.
    """
    to_index = np.linalg.inv(bone.T_upright_voxel)
    low, high = _box(grid.nodes() @ to_index[:3, :3].T + to_index[:3, 3], bone)
    low, high = np.clip(low, 0, bone.mask.shape), np.clip(high, 0, bone.mask.shape)
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    block = bone.mask[box]
    edge = max(1, int(np.ceil(np.cbrt(np.prod((high - low).astype(np.float64)) / MOST_LABELLED))))
    solid = block if edge == 1 else pooled(block, np.full(3, edge))
    large = large_pieces(solid)
    if large.sum() == solid.sum():
        return bone
    mask = bone.mask.copy(order="K")
    held = mask[box]
    for k in range(held.shape[2]):  # layer by layer, to spare memory
        kept = np.repeat(np.repeat(large[:, :, k // edge], edge, 0), edge, 1)
        held[:, :, k] &= kept[: held.shape[0], : held.shape[1]]
    return replace(bone, mask=mask)


def _distance_at(bone: BoneVolume, places: Floats) -> Floats:
    """Return the smoothed distance (n,) at places (n, 3) among the voxels."""
    voxel = bone.voxel_mm()
    low, high = _box(places, bone)
    inner_low = np.clip(low, 0, bone.mask.shape)
    inner_high = np.clip(high, 0, bone.mask.shape)
    block = np.zeros(high - low, dtype=np.bool_)
    source = bone.mask[tuple(slice(a, b) for a, b in zip(inner_low, inner_high, strict=True))]
    block[
        tuple(slice(a - o, b - o) for a, b, o in zip(inner_low, inner_high, low, strict=True))
    ] = source
    if block.all() or not block.any():
        return np.full(len(places), -2.0 * BAND_MM if block.any() else 2.0 * BAND_MM)
    half = float(voxel.mean()) / 2.0
    signed = _to_nearest(~block, voxel)
    signed[block] = -_to_nearest(block, voxel)[block]
    signed -= np.where(block, -half, half).astype(np.float32)
    smooth = gaussian_filter(np.clip(signed, -2 * BAND_MM, 2 * BAND_MM), SMOOTHING_VOXELS)
    values = map_coordinates(smooth, (places - low).T, order=3, mode="nearest")
    return values.astype(np.float64)


def _to_nearest(inside: Bools, voxel_mm: Floats) -> NDArray[np.float32]:
    """Return for each voxel inside the distance to the nearest centre outside, else 0."""
    nearest: Any = distance_transform_edt(
        inside, sampling=voxel_mm, return_distances=False, return_indices=True
    )
    distance = np.zeros(inside.shape, dtype=np.float32)
    j, k = np.ogrid[: inside.shape[1], : inside.shape[2]]
    for i in range(inside.shape[0]):  # layer by layer: the offsets as floats are large
        offsets = (nearest[0, i] - i, nearest[1, i] - j, nearest[2, i] - k)
        squares = sum((off * edge) ** 2 for off, edge in zip(offsets, voxel_mm, strict=True))
        distance[i] = np.sqrt(squares)
    return distance


def distance_from_mesh(bone: BoneMesh, grid: Grid) -> Floats:
    """Return the distance on the grid, exact near the surface."""
    nodes = grid.nodes()
    columns = nodes.reshape(*grid.shape, 3)[:, :, 0].reshape(-1, 3)
    step = grid.axes_upright[:, 2] * grid.spacing_mm
    solid = inside(bone, columns, step, grid.shape[2]).ravel()
    distance = distance_to(bone, nodes, BAND_MM, exact_mm=2.0 * grid.spacing_mm)
    return np.where(solid, -distance, distance).reshape(grid.shape)


def as_micrometres(distance_mm: Floats) -> NDArray[np.int16]:
    """Return a distance, clipped to the band, in whole micrometres."""
    clipped = np.clip(distance_mm, -BAND_MM, BAND_MM)
    return np.round(1000.0 * clipped).astype(np.int16)
