"""Hole filling: unmeasured voxels from measured ones beside them, along the outer boundary."""

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Bools, Floats


def fill_holes(
    amplitude: NDArray[np.float32],
    measured: Bools,
    height_mm: Floats,
    *,
    steps_mm: tuple[float, float, float],
    radius_mm: float,
) -> tuple[NDArray[np.float32], Bools]:
    """Return amplitudes with holes filled, and which voxels were filled, both (nu, nv, nz).

    A hole takes the mean, weighted by the inverse square of the distance, of the measured voxels
    as deep below the outer boundary as itself in the columns within the radius: neighbours at the
    same height would smear a ridge that is not level. Measured voxels are not touched.

    Args:
        amplitude: Of the voxels (nu, nv, nz).
        measured: Which of them were measured (nu, nv, nz).
        height_mm: Of the outer boundary over the columns (nu, nv).
        steps_mm: Size of a voxel along u, v and z.
        radius_mm: Distance in the u-v plane within which columns count; 0 fills nothing.
    """
    total = np.zeros(amplitude.shape)
    weight = np.zeros(amplitude.shape)
    known = np.where(measured, amplitude, 0.0)
    for i, j, distance_mm in _offsets(steps_mm[:2], radius_mm):
        here, there = _overlap(i, j, amplitude.shape)
        up = (height_mm[there] - height_mm[here]) / steps_mm[2]
        values, sure = _lifted(known[there], measured[there], up)
        total[here] += values / distance_mm**2
        weight[here] += sure / distance_mm**2
    filled = ~measured & (weight > 0.0)
    values = np.divide(total, weight, out=np.zeros(amplitude.shape), where=filled)
    return np.where(filled, values, known).astype(np.float32), filled


def _offsets(cell_mm: tuple[float, float], radius_mm: float) -> list[tuple[int, int, float]]:
    """Return steps in u and v to the columns within the radius, and how far each lies."""
    reach = [int(radius_mm / cell) for cell in cell_mm]
    steps = [
        (i, j, float(np.hypot(i * cell_mm[0], j * cell_mm[1])))
        for i in range(-reach[0], reach[0] + 1)
        for j in range(-reach[1], reach[1] + 1)
    ]
    return [step for step in steps if 0.0 < step[2] <= radius_mm]


def _overlap(i: int, j: int, shape: tuple[int, ...]) -> tuple[tuple[slice, ...], ...]:
    """Return the columns that have a neighbour at this offset, and those neighbours."""
    here = tuple(slice(max(0, -k), n - max(0, k)) for k, n in zip((i, j), shape, strict=False))
    there = tuple(slice(max(0, k), n - max(0, -k)) for k, n in zip((i, j), shape, strict=False))
    return here, there


def _lifted(values: Floats, sure: Bools, up: Floats) -> tuple[Floats, Bools]:
    """Return columns (a, b, nz) shifted down by ``up`` (a, b) samples, and where they are sure."""
    n = values.shape[2]
    place = np.arange(n) + up[:, :, None]
    whole = np.floor(place).astype(np.int64)
    inside = (whole >= 0) & (whole < n - 1)
    whole = np.clip(whole, 0, n - 2)
    share = place - whole
    lower, upper = (np.take_along_axis(values, whole + k, axis=2) for k in (0, 1))
    both = inside & np.take_along_axis(sure, whole, axis=2)
    both &= np.take_along_axis(sure, whole + 1, axis=2)
    return np.where(both, (1.0 - share) * lower + share * upper, 0.0), both
