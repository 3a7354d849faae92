"""A CT of the bone that maps show."""

import nibabel
import numpy as np
from scipy.interpolate import RegularGridInterpolator

from rona_core.mapping import Maps


def ct_of(
    maps: Maps, voxel_mm: float = 0.5, moved_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> bytes:
    """Return a NIfTI file of the bone between two maps, 1500 and air 0, on the axes of the map."""
    outer, inner = maps.outer, maps.inner
    u = np.arange(outer.u_mm[0], outer.u_mm[-1], voxel_mm)
    v = np.arange(outer.v_mm[0], outer.v_mm[-1], voxel_mm)
    low, high = np.nanmin(inner.height_mm[inner.ok]) - 3.0, np.max(outer.height_mm[outer.ok]) + 3.0
    z = np.arange(low, high, voxel_mm)
    there = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    top, bottom = (
        RegularGridInterpolator((m.u_mm, m.v_mm), np.where(m.ok, m.height_mm, np.nan))(there)
        for m in (outer, inner)
    )
    above, below = (top[..., None] - z) / voxel_mm, (z - bottom[..., None]) / voxel_mm
    bone = np.clip(above + 0.5, 0.0, 1.0) * np.clip(below + 0.5, 0.0, 1.0)
    affine = outer.T_base_map.matrix() @ np.diag((voxel_mm, voxel_mm, voxel_mm, 1.0))
    affine[:3, 3] = outer.T_base_map @ np.array((u[0], v[0], z[0])) + moved_mm
    image = nibabel.Nifti1Image((1500.0 * np.nan_to_num(bone)).astype(np.float32), affine)
    image.header.set_xyzt_units("mm")
    return image.to_bytes()
