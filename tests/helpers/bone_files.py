"""Files of a small head, as volumes in any space and as meshes, whole or spoilt."""

from functools import cache
from pathlib import Path

import nibabel
import nrrd
import numpy as np

VOXEL_MM = 2.0
RADII_MM = np.array((70.0, 84.0, 74.0))  # of the outer surface, in left, posterior, superior
BONE_MM = 7.0


CENTER_MM = np.array((70.0, 18.8, 14.8))  # on the outer surface, to the left


@cache
def parts():
    """Return the voxels (nx, ny, nz) of a filled head with a face, of its cavity, and of its bone.

    Axes grow to the left, the back and up; the middle of the grid is that of the braincase, which
    is wider behind and has a flat base. The bone has a hole below and one in its right side.
    """
    half = np.ceil((RADII_MM + (6.0, 26.0, 28.0)) / VOXEL_MM).astype(int)
    x, y, z = (VOXEL_MM * np.arange(-n, n + 1) for n in half)
    p = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    wider = 1.0 + 0.0025 * p[..., 1]
    egg = np.stack((p[..., 0] / wider, p[..., 1], p[..., 2] / wider), axis=-1)
    outer = (((egg / RADII_MM) ** 2).sum(axis=-1) <= 1.0) & (p[..., 2] > -40.0)
    cavity = ((egg / (RADII_MM - BONE_MM)) ** 2).sum(axis=-1) < 1.0
    cavity &= p[..., 2] > -40.0 + BONE_MM
    below = (p[..., 2] < -20.0) & (np.hypot(p[..., 0], p[..., 1] - 20.0) < 16.0)
    right = (p[..., 0] < 0.0) & (np.hypot(p[..., 1] - 30.0, p[..., 2] - 8.0) < 9.0)
    face = (np.abs(p[..., 0]) < 34.0) & (p[..., 1] < -35.0) & (p[..., 1] > -90.0)
    face &= (p[..., 2] < -14.0) & (p[..., 2] > -90.0) & ~cavity
    orbits = (np.hypot(np.abs(p[..., 0]) - 17.0, p[..., 2] + 30.0) < 11.0) & (p[..., 1] < -55.0)
    filled, bone = outer | face, (outer & ~cavity & ~below & ~right) | (face & ~orbits)
    for mask in (filled, cavity, bone):
        mask.setflags(write=False)
    return filled, cavity, bone


def head():
    """Return the voxels (nx, ny, nz) of the bone."""
    return parts()[2]


def placed(T_mesh_lps=None):
    """Return the affine (4, 4) of the head in a file, whose coordinates are turned and shifted."""
    affine = np.diag((VOXEL_MM,) * 3 + (1.0,))
    affine[:3, 3] = -0.5 * VOXEL_MM * (np.array(head().shape) - 1.0)
    return affine if T_mesh_lps is None else T_mesh_lps @ affine


def as_nifti(path, values, affine, unit="mm"):
    """Write a NIfTI file; the affine is in right, anterior, superior."""
    image = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units(unit)
    nibabel.save(image, path)
    return Path(path)


def as_nrrd(path, values, affine, space="left-posterior-superior", **header):
    """Write an NRRD file; the affine is in the coordinates of the space."""
    fields = {
        "space directions": affine[:3, :3].T,
        "space origin": affine[:3, 3],
        "encoding": "gzip",
        **({"space": space} if space else {"space dimension": 3}),
        **header,
    }
    nrrd.write(str(path), np.ascontiguousarray(values), fields)
    return Path(path)
