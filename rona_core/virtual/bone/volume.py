"""Read bone from a volume file: a mask, or a CT with the grey value that separates bone."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np

from rona_core.arrays import Bools, Floats
from rona_core.errors import InvalidInputError

VOLUME_SUFFIXES = (".nrrd", ".nii", ".nii.gz")
MOST_VOXELS = 500_000_000
VOXELS_MM = (0.1, 3.0)  # edges of a voxel
SKEW = 1e-3  # largest cosine between grid axes
LEAST_BONE_MM3 = 5000.0
MOST_BONE = 0.7  # of all voxels

# which way y grows: +1 to the back, -1 to the front, 0 not said
BACK = {
    "left-posterior-superior": 1,
    "lps": 1,
    "right-anterior-superior": -1,
    "ras": -1,
    "left-anterior-superior": -1,
    "las": -1,
}


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
    data, affine, back = _read_nrrd(path) if path.suffix == ".nrrd" else _read_nifti(path)
    _check_grid(path.name, affine)
    low, high = data.min(), data.max()
    if not (np.isfinite(low) and np.isfinite(high)):
        raise InvalidInputError(f"{path.name} holds values that are not finite: repair the file")
    if low == high:
        raise InvalidInputError(
            f"{path.name} holds only the value {low:g}: expected bone and air in one volume"
        )
    upper = data == high
    binary = bool((upper | (data == low)).all())
    if threshold is None and not binary:
        raise InvalidInputError(
            f"{path.name} holds grey values from {low:g} to {high:g}, so it is no mask: give the "
            f"threshold from which a value is bone (for a CT about 300, for labels 0.5)"
        )
    mask = upper if threshold is None else data >= threshold
    share, bone_mm3 = float(mask.mean()), float(mask.sum()) * abs(np.linalg.det(affine[:3, :3]))
    if bone_mm3 < LEAST_BONE_MM3 or share > MOST_BONE:
        raise InvalidInputError(
            f"{path.name} has {bone_mm3 / 1000:.1f} cm3 of bone, {share:.0%} of the volume: "
            f"expected a skull surrounded by air; check the threshold or whether it is inverted"
        )
    return BoneVolume(np.asarray(mask, dtype=np.bool_), affine, back, not binary)


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
    outside = float((inner.mask & ~outer.mask).sum()) / float(inner.mask.sum())
    if outside > 0.01:
        raise InvalidInputError(
            f"{outside:.0%} of the inner volume lies outside the outer one: expected the filled "
            f"head first and the filled cavity as inner file"
        )
    mask = outer.mask & ~inner.mask
    return BoneVolume(mask, outer.T_skull_voxel, outer.back, outer.grey or inner.grey)


def _read_nrrd(path: Path) -> tuple[Any, Floats, int]:
    try:
        header = nrrd.read_header(str(path))
        _check_size(path.name, tuple(int(n) for n in header["sizes"]))
        data, header = nrrd.read(str(path))
        axes = header.get("space directions")
        if axes is None:
            spacings = header.get("spacings")
            axes = None if spacings is None else np.diag(spacings)
        origin = header.get("space origin", np.zeros(3))
    except InvalidInputError:
        raise
    except Exception as error:
        raise InvalidInputError(
            f"{path.name} could not be read as NRRD ({error}): export it again"
        ) from error
    if axes is None:
        raise InvalidInputError(f"{path.name} does not say how large its voxels are: export again")
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = np.asarray(axes, dtype=np.float64).T, origin
    return data, affine, BACK.get(str(header.get("space", "")).lower(), 0)


def _read_nifti(path: Path) -> tuple[Any, Floats, int]:
    try:
        image: Any = nibabel.load(path)
        shape = tuple(int(n) for n in image.shape)
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        _check_size(path.name, shape)
        unit = image.header.get_xyzt_units()[0]
        data = np.asanyarray(image.dataobj).reshape(shape)
        affine = np.array(image.affine, dtype=np.float64)
    except InvalidInputError:
        raise
    except Exception as error:
        raise InvalidInputError(
            f"{path.name} could not be read as NIfTI ({error}): export it again"
        ) from error
    if unit in ("meter", "micron"):
        raise InvalidInputError(f"{path.name} is in units of {unit}: expected millimetres")
    return data, affine, -1


def _check_size(name: str, shape: tuple[int, ...]) -> None:
    if len(shape) != 3 or min(shape) < 8:
        raise InvalidInputError(
            f"{name} must be one volume of at least 8 voxels a side, not {shape}: export one "
            f"scalar volume"
        )
    if np.prod([float(n) for n in shape]) > MOST_VOXELS:
        raise InvalidInputError(
            f"{name} has {shape} voxels: at most {MOST_VOXELS / 1e6:.0f} million; crop or resample"
        )


def _check_grid(name: str, affine: Floats) -> None:
    if not np.isfinite(affine).all():
        raise InvalidInputError(f"{name} has a grid that is not finite: export it again")
    edges = np.linalg.norm(affine[:3, :3], axis=0)
    low, high = VOXELS_MM
    if edges.min() < low or edges.max() > high:
        raise InvalidInputError(
            f"{name} has voxels of {edges.round(4).tolist()}: expected {low:g} to {high:g} mm; "
            f"check the unit"
        )
    unit = affine[:3, :3] / edges
    if np.abs(unit.T @ unit - np.eye(3)).max() > SKEW:
        raise InvalidInputError(f"{name} has a skewed grid: resample it to right angles")
