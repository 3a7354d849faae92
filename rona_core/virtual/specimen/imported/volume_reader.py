"""Reader of bone volumes: a mask, or a CT with a threshold."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rona_core.devices.files.voxels.refusals import refused
from rona_core.devices.files.voxels.voxel_layers import Voxels
from rona_core.devices.files.voxels.voxel_reader import grey_values, open_voxels
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.mesh import Reals
from rona_core.geometry.pose import Pose
from rona_core.virtual.specimen.imported.upright_frame import upright_frame

LEAST_BONE_MM3 = 5000.0
MOST_BONE_SHARE = 0.7  # of all voxels
MOST_LABELS = 256  # different values; more are grey values
TOUCHING_VOXELS = 1.5  # that a cavity may reach out of the head: two segmentations round apart
DEEPEST_MM = 10.0  # that its depth is looked for
MOST_TRIED = 50  # voxels whose depth is measured
ALONG = 0.5  # cosine up to which an axis of the file says nothing of one of the head


@dataclass(frozen=True, slots=True, eq=False)
class BoneVolume:
    """Which voxels are bone."""

    mask: Bools  # (nx, ny, nz)
    T_upright_voxel: Floats  # (4, 4): upright coordinates of an index, in mm, along the axes
    back: int  # +1 if y grows to the back of the upright head, -1 to the front, 0 unknown
    grey: bool  # it came from grey values and a threshold
    T_skull_upright: Pose = field(default_factory=Pose.identity)  # in the coordinates of the file

    def voxel_mm(self) -> Floats:
        """Return the edges (3,) of a voxel."""
        return np.linalg.norm(self.T_upright_voxel[:3, :3], axis=0)

    def T_skull_voxel(self) -> Floats:  # noqa: N802 (frame grammar)
        """Return the coordinates of an index in the file, (4, 4)."""
        return self.T_skull_upright.matrix() @ self.T_upright_voxel


def read_volume(path: Path, threshold: float | None, label: int | None = None) -> BoneVolume:
    """Read a mask, a map of labels or a CT.

    Args:
        path: A .nrrd, .nii or .nii.gz file, coordinates in mm.
        threshold: Values of at least this are bone.
        label: Values of exactly this are. With neither, the file must have two values only.

    Raises:
        InvalidInputError: damaged, foreign, empty, or of many values without threshold and label.
    """
    name = path.name
    if threshold is not None and label is not None:
        raise refused("threshold and label at once", threshold=threshold, label=label)
    with open_voxels(path, name) as voxels:
        affine = voxels.T_mesh_voxel
        mask, values = _labelled_pieces(voxels, threshold, label, name)
    low, high = values.low, values.high
    if low == high:
        raise refused("one value only", name=name, low=low)
    if threshold is None and label is None and len(values.found) != 2:
        if values.are_labels():
            raise refused("labels without a label", name=name, labels=values.listed())
        raise grey_values(name, low, high)
    count = int(np.count_nonzero(mask))
    if label is not None and not count:
        raise refused(
            "a label that it does not hold", name=name, label=label, labels=values.listed()
        )
    if threshold is not None and count in (0, mask.size):
        raise refused(
            "a threshold beyond its values", name=name, low=low, high=high, threshold=threshold
        )
    share, bone_mm3 = count / mask.size, count * abs(float(np.linalg.det(affine[:3, :3])))
    if bone_mm3 < LEAST_BONE_MM3:
        least = LEAST_BONE_MM3 / 1000.0
        raise refused("too little bone", name=name, bone_cm3=bone_mm3 / 1000.0, least_cm3=least)
    if share > MOST_BONE_SHARE:
        raise refused("too much bone", name=name, share=share)
    T_upright_voxel, T_skull_upright = upright_frame(affine)
    along = voxels.back * float(T_skull_upright.rotation[1, 1])  # the file's y
    back = int(np.sign(along)) if abs(along) > ALONG else 0
    return BoneVolume(mask, T_upright_voxel, back, threshold is not None, T_skull_upright)


@dataclass(slots=True)
class _Values:
    """The values of a volume: their ends, and which they are as long as they are few."""

    low: float = np.inf
    high: float = -np.inf
    found: set[float] = field(default_factory=set[float])  # one too many where there are more

    def take(self, slab: Reals) -> None:
        """Add those of some layers."""
        self.low, self.high = min(self.low, float(slab.min())), max(self.high, float(slab.max()))
        for layer in np.moveaxis(slab, 2, 0):
            if len(self.found) <= MOST_LABELS:
                self.found.update(np.unique(layer)[: MOST_LABELS + 1].tolist())

    def are_labels(self) -> bool:
        """Return whether they are few whole numbers, none of them negative."""
        few = len(self.found) <= MOST_LABELS
        return few and all(value >= 0.0 and value == int(value) for value in self.found)

    def listed(self) -> str:
        """Return them as words, or their ends."""
        if len(self.found) > MOST_LABELS:
            return f"{self.low:g} to {self.high:g}"
        return ", ".join(f"{value:g}" for value in sorted(self.found))


def _labelled_pieces(
    voxels: Voxels, threshold: float | None, label: int | None, name: str
) -> tuple[Bools, _Values]:
    """Return the mask, of the highest value without threshold and label, and the values.

    Raises:
        InvalidInputError: a value that is not finite, or damaged data.
    """
    mask = np.zeros(voxels.shape, dtype=np.bool_, order="F")
    values = _Values()
    ranges: list[tuple[int, int, float]] = []
    first = 0
    for slab in voxels.slabs:
        high = float(slab.max())
        if not (np.isfinite(float(slab.min())) and np.isfinite(high)):
            raise refused("values that are not finite", name=name)
        values.take(slab)
        end = first + slab.shape[2]
        if threshold is not None:
            mask[:, :, first:end] = slab >= threshold
        else:
            mask[:, :, first:end] = slab == (high if label is None else label)
        ranges.append((first, end, high))
        first = end
    if threshold is None and label is None:
        for first, end, high in ranges:
            if high < values.high:  # these layers hold no bone
                mask[:, :, first:end] = False
    return mask, values


def without(outer: BoneVolume, inner: BoneVolume) -> BoneVolume:
    """Return the bone between a filled head and a filled cavity.

    Raises:
        InvalidInputError: different grids, or a cavity that reaches out of the head.
    """
    same = outer.mask.shape == inner.mask.shape and np.allclose(
        outer.T_skull_voxel(), inner.T_skull_voxel(), atol=1e-3
    )
    if not same:
        raise refused("two grids", outer=outer.mask.shape, inner=inner.mask.shape)
    # of truth values, "greater" is "the one and not the other"
    beyond = np.argwhere(np.greater(inner.mask, outer.mask))
    if len(beyond):
        depth = _depths(outer, beyond[:: max(1, len(beyond) // MOST_TRIED)])
        worst = int(depth.argmax())
        if depth[worst] > TOUCHING_VOXELS * outer.voxel_mm().max():
            voxel = beyond[:: max(1, len(beyond) // MOST_TRIED)][worst]
            T = outer.T_skull_voxel()
            raise refused(
                "an inner volume outside the outer one",
                outside=len(beyond) / float(np.count_nonzero(inner.mask)),
                depth_mm=depth[worst],
                place=(T[:3, :3] @ voxel + T[:3, 3]).round(1).tolist(),
            )
    mask = np.greater(outer.mask, inner.mask)
    return replace(outer, mask=mask, grey=outer.grey or inner.grey)


def _depths(bone: BoneVolume, voxels: Ints) -> Floats:
    """Return how far (n,) voxels (n, 3) lie from the nearest of the bone, in mm; at most 20."""
    voxel = bone.voxel_mm()
    margin = np.ceil(DEEPEST_MM / voxel).astype(np.int64)
    depths = np.full(len(voxels), DEEPEST_MM)
    for row, place in enumerate(voxels):
        low = np.maximum(place - margin, 0)
        box = bone.mask[tuple(slice(a, b) for a, b in zip(low, place + margin + 1, strict=True))]
        index = np.argwhere(box)
        if len(index):
            off = np.linalg.norm((index + low - place) * voxel, axis=1)
            depths[row] = min(DEEPEST_MM, float(off.min()))
    return depths


def pooled(mask: Bools, blocks: Ints) -> Bools:
    """Return which blocks of so many voxels (3,) hold any bone: what is joined stays joined."""
    for axis, step in enumerate(blocks):
        starts = np.arange(0, mask.shape[axis], int(step))
        mask = np.logical_or.reduceat(mask, starts, axis=axis)
    return mask
