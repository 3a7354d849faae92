"""Reader of bone volumes: a mask, or a CT with a threshold."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rona_core.devices.files.voxels.voxel_layers import Voxels
from rona_core.devices.files.voxels.voxel_reader import grey_values, open_voxels
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints

LEAST_BONE_MM3 = 5000.0
MOST_BONE_SHARE = 0.7  # of all voxels


@dataclass(frozen=True, slots=True, eq=False)
class BoneVolume:
    """Which voxels are bone."""

    mask: Bools  # (nx, ny, nz)
    T_skull_voxel: Floats  # (4, 4): skull coordinates of an index, in mm
    back: int  # +1 if y grows to the back of the head, -1 to the front, 0 unknown
    grey: bool  # it came from grey values and a threshold

    def voxel_mm(self) -> Floats:
        """Return the edges (3,) of a voxel."""
        return np.linalg.norm(self.T_skull_voxel[:3, :3], axis=0)


def read_volume(path: Path, threshold: float | None) -> BoneVolume:
    """Read a mask or a CT.

    Args:
        path: A .nrrd, .nii or .nii.gz file, coordinates in mm.
        threshold: Values of at least this are bone; None for a file with two values only.

    Raises:
        InvalidInputError: damaged, foreign, empty, or grey values without a threshold.
    """
    with open_voxels(path, path.name) as voxels:
        affine = voxels.T_mesh_voxel
        mask, low, high, binary = _told_apart(voxels, threshold, path.name)
    if low == high:
        raise InvalidInputError(
            f"{path.name} holds only the value {low:g}: expected bone and air in one volume"
        )
    if threshold is None and not binary:
        raise grey_values(path.name, low, high)
    count = int(np.count_nonzero(mask))
    share, bone_mm3 = count / mask.size, count * abs(float(np.linalg.det(affine[:3, :3])))
    if bone_mm3 < LEAST_BONE_MM3 or share > MOST_BONE_SHARE:
        raise InvalidInputError(
            f"{path.name} has {bone_mm3 / 1000:.1f} cm3 of bone, {share:.0%} of the volume: "
            f"expected a skull surrounded by air; check the threshold or whether it is inverted"
        )
    return BoneVolume(mask, affine, voxels.back, not binary)


def _told_apart(
    voxels: Voxels, threshold: float | None, name: str
) -> tuple[Bools, float, float, bool]:
    """Return the mask, the lowest and the highest value, and whether there are no others.

    Raises:
        InvalidInputError: a value that is not finite, or damaged data.
    """
    mask = np.zeros(voxels.shape, dtype=np.bool_, order="F")
    found: set[float] = set()
    ranges: list[tuple[int, int, float, float]] = []
    binary, first = True, 0
    for slab in voxels.slabs:
        low, high = float(slab.min()), float(slab.max())
        if not (np.isfinite(low) and np.isfinite(high)):
            raise InvalidInputError(f"{name} holds values that are not finite: repair the file")
        upper = slab == slab.max()
        found = {*found, low, high} if len(found) <= 2 else found
        binary = binary and len(found) <= 2 and bool((upper | (slab == slab.min())).all())
        end = first + slab.shape[2]
        mask[:, :, first:end] = upper if threshold is None else slab >= threshold
        ranges.append((first, end, low, high))
        first = end
    lowest, highest = min(part[2] for part in ranges), max(part[3] for part in ranges)
    if threshold is None:
        for first, end, _, high in ranges:
            if high < highest:  # these layers hold no bone
                mask[:, :, first:end] = False
    return mask, lowest, highest, binary


def without(outer: BoneVolume, inner: BoneVolume) -> BoneVolume:
    """Return the bone between a filled head and a filled cavity.

    Raises:
        InvalidInputError: different grids, or a cavity that is not inside the head.
    """
    same = outer.mask.shape == inner.mask.shape and np.allclose(
        outer.T_skull_voxel, inner.T_skull_voxel, atol=1e-3
    )
    if not same:
        raise InvalidInputError(
            f"the outer grid is {outer.mask.shape}, the inner {inner.mask.shape}, or they "
            f"lie elsewhere: export both on one grid"
        )
    # of truth values, "greater" is "the one and not the other"
    beyond = np.count_nonzero(np.greater(inner.mask, outer.mask))
    outside = float(beyond) / float(np.count_nonzero(inner.mask))
    if outside > 0.01:
        raise InvalidInputError(
            f"{outside:.0%} of the inner volume lies outside the outer one: expected the filled "
            f"head first and the filled cavity as inner file"
        )
    mask = np.greater(outer.mask, inner.mask)
    return BoneVolume(mask, outer.T_skull_voxel, outer.back, outer.grey or inner.grey)


def pooled(mask: Bools, blocks: Ints) -> Bools:
    """Return which blocks of so many voxels (3,) hold any bone: what is joined stays joined."""
    for axis, step in enumerate(blocks):
        starts = np.arange(0, mask.shape[axis], int(step))
        mask = np.logical_or.reduceat(mask, starts, axis=axis)
    return mask
