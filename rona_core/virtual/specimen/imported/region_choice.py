"""Choice of the scanned region of an imported skull: a smooth, whole patch of the calotte.

Works on the bone at about 1 mm, with x to a side and z up, seen along x from both sides.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import binary_closing, gaussian_filter, label

from rona_core.devices.files.voxels.refusals import refused
from rona_core.geometry.arrays import Bools, Floats, Ints, Vector3

SMALL_PIECE = 0.05  # bone pieces below this share of the largest do not count (table, dust)
GAP_MM = 6.0  # air between bone (diploe, air cells) that counts as bone
WORK_MM = 1.0
ROWS = 32  # looked through at once
SMOOTH_MM = 5.0
THICKNESS_MM = (3.0, 10.0)
RIM_MM = 4.0  # beyond the disc that must be whole too
LARGEST_STEP_MM = 2.5  # of the surface against its smooth course
STEEPEST = np.cos(np.deg2rad(55.0))  # between the bone's normal and the line of sight
BELOW_TOP_MM = 73.0  # wished height of the centre: vertex to ear canal, less 45 mm
BEFORE_BACK_MM = 58.0  # wished place: occiput to ear canal, less 35 mm
WISH_MM = 18.0  # a distance from the wished place that weighs like a unit of badness


@dataclass(frozen=True, slots=True, eq=False)
class CoarseBone:
    """The bone on an axis-aligned grid of about 1 mm, axes ascending in ``upright``."""

    mask: Bools  # (nx, ny, nz)
    origin_upright: Vector3  # of voxel (0, 0, 0)
    voxel_mm: Floats  # (3,)
    back: int  # +1 if y grows to the back, -1 to the front, 0 unknown

    def highest_mm(self, center_upright: Vector3, axes_upright: Floats, half_mm: float) -> float:
        """Return how far bone rises above a point, along the third of the axes (3, 3).

        Within half the width of a square along the other two, and no farther off than the corners
        of the cube on it. Small pieces do not count.
        """
        place, reach = center_upright - self.origin_upright, np.sqrt(3.0) * half_mm
        first = np.clip((place - reach) // self.voxel_mm, 0, None).astype(np.int64)
        end = np.clip((place + reach) // self.voxel_mm + 1, 0, None).astype(np.int64)
        box = self.mask[tuple(slice(a, b) for a, b in zip(first, end, strict=True))]
        voxels = first + np.argwhere(large_pieces(box))
        u, v, w = ((voxels * self.voxel_mm - place) @ axes_upright).T
        inside = (np.abs(u) <= half_mm) & (np.abs(v) <= half_mm)
        return float(w[inside].max(initial=0.0))


def large_pieces(mask: Bools) -> Bools:
    """Return which voxels of a mask belong to a piece that is not small beside the largest."""
    pieces = np.zeros(mask.shape, dtype=np.int32)
    label(mask, output=pieces)
    sizes = np.bincount(pieces.ravel(), minlength=1)
    sizes[:1] = 0
    return (sizes >= np.maximum(SMALL_PIECE * sizes.max(), 1.0))[pieces]


def coarse_bone(mask: Bools, T_upright_voxel: Floats, back: int) -> CoarseBone:
    """Thin out a volume, whose voxels lie along the axes, to about 1 mm; its axes then ascend."""
    edges = np.linalg.norm(T_upright_voxel[:3, :3], axis=0)
    order = np.argmax(np.abs(T_upright_voxel[:3, :3]), axis=1)  # voxel axis for each axis
    strides = np.maximum(1, np.floor(WORK_MM / edges + 1e-6)).astype(int)
    thin = mask[:: strides[0], :: strides[1], :: strides[2]].transpose(*order)
    affine = T_upright_voxel[:3, :3] * strides
    start = T_upright_voxel[:3, 3].copy()
    flips = [slice(None)] * 3
    for axis in range(3):
        column = affine[:, order[axis]]
        if column[axis] < 0.0:
            start += column * (thin.shape[axis] - 1)
            flips[axis] = slice(None, None, -1)
    return CoarseBone(thin[tuple(flips)], start, (edges * strides)[order], back)


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A place to scan and the line of sight that found it."""

    center_upright: Vector3
    outward_upright: Vector3


def choose_region(bone: CoarseBone, radius_mm: float) -> Choice:
    """Return a smooth, whole place on the side of the head for a disc.

    Raises:
        InvalidInputError: neither side has one.
    """
    best: tuple[float, Choice] | None = None
    for side in (1, -1):
        found = _best_on_side(bone, side, radius_mm)
        if found is not None and (best is None or found[0] < best[0]):
            best = found
    if best is None:
        raise refused("no whole patch", radius_mm=radius_mm)
    return best[1]


def side_view(bone: CoarseBone, side: int) -> tuple[Floats, Floats, Bools]:
    """Return what is seen along x from one side.

    Returns:
        Depth in mm below the first plane, thickness in mm along x (gaps bridged), and where bone
        was hit before the middle of the head, each (ny, nz).
    """
    half = (bone.mask.shape[0] + 1) // 2
    block = bone.mask[::-1][:half] if side > 0 else bone.mask[:half]
    step = float(bone.voxel_mm[0])
    length = max(1, int(np.ceil(GAP_MM / step)) - 1)
    parts = [
        _seen_along(block[:, j : j + ROWS], length) for j in range(0, block.shape[1], ROWS)
    ]  # columns know nothing of each other: some rows at a time, to spare memory
    first, count, hit = (np.concatenate(part) for part in zip(*parts, strict=True))
    return first * step, count * step, hit


def _seen_along(block: Bools, length: int) -> tuple[Ints, Ints, Bools]:
    """Return first bone and its extent along the first axis in voxels, and where there is any."""
    half = len(block)
    hit: Bools = np.asarray(block.any(axis=0))
    first = np.argmax(block, axis=0)
    padded = np.pad(block, ((length, length), (0, 0), (0, 0)))
    closed: Any = np.asarray(binary_closing(padded, np.ones((length + 1, 1, 1))))[length:-length]
    closed = closed | block
    beyond = ~closed & (np.arange(half)[:, None, None] > first)
    end = np.where(beyond.any(axis=0), np.argmax(beyond, axis=0), half)
    return first, end - first, hit


def _best_on_side(bone: CoarseBone, side: int, radius_mm: float) -> tuple[float, Choice] | None:
    depth, across, hit = side_view(bone, side)
    _, dy, dz = bone.voxel_mm
    sigma = (SMOOTH_MM / dy, SMOOTH_MM / dz)
    weight = np.maximum(gaussian_filter(hit.astype(np.float64), sigma), 1e-6)
    smooth = gaussian_filter(np.where(hit, depth, 0.0), sigma) / weight
    slope_y, slope_z = np.gradient(smooth, dy, dz)
    slope_y, slope_z = np.asarray(slope_y), np.asarray(slope_z)
    cosine = 1.0 / np.sqrt(1.0 + slope_y**2 + slope_z**2)
    thickness = across * cosine
    rough = np.where(hit, (depth - smooth) * cosine, 2.0 * LARGEST_STEP_MM)
    low, high = THICKNESS_MM
    odd = (thickness < low) | (thickness > high) | ~hit
    broken = _mean(np.abs(rough) > LARGEST_STEP_MM, radius_mm + RIM_MM, dy, dz) > 1e-6
    whole = (_mean(~hit, radius_mm + RIM_MM, dy, dz) < 1e-6) & ~broken & (cosine > STEEPEST)
    mean = _mean(thickness, radius_mm, dy, dz)
    spread = np.sqrt(np.maximum(_mean(thickness**2, radius_mm, dy, dz) - mean**2, 0.0))
    roughness = np.sqrt(np.maximum(_mean(rough**2, radius_mm, dy, dz), 0.0))
    bad = roughness + spread + 10.0 * _mean(odd, radius_mm, dy, dz) + _wish(bone)
    bad = np.where(whole, bad, np.inf)
    j, k = np.unravel_index(int(np.argmin(bad)), bad.shape)
    if not np.isfinite(bad[j, k]):
        return None
    steps = depth[j, k]
    x_first = bone.voxel_mm[0] * (bone.mask.shape[0] - 1) - steps if side > 0 else steps
    center = bone.origin_upright + np.array((x_first, j * dy, k * dz))
    outward = np.array((float(side), side * 0.0, 0.0))
    outward[1:] = slope_y[j, k], slope_z[j, k]  # depth grows away from the viewer
    return float(bad[j, k]), Choice(center, outward / np.linalg.norm(outward))


def _mean(values: Floats | Bools, radius_mm: float, dy: float, dz: float) -> Floats:
    """Return the mean over a disc about every place; outside the view counts as the worst, 1."""
    from scipy.signal import fftconvolve  # 0.2 s, which who loads no skull need not wait for

    ny, nz = int(radius_mm / dy), int(radius_mm / dz)
    y, z = np.ogrid[-ny : ny + 1, -nz : nz + 1]
    disc = ((y * dy) ** 2 + (z * dz) ** 2 <= radius_mm**2).astype(np.float64)
    padded = np.pad(np.asarray(values, dtype=np.float64), ((ny, ny), (nz, nz)), constant_values=1.0)
    return fftconvolve(padded, disc / disc.sum(), mode="valid")


def _wish(bone: CoarseBone) -> Floats:
    """Return how far (ny, nz) places are from the wished one, squared, in units of badness."""
    _, dy, dz = bone.voxel_mm
    heights = np.flatnonzero(bone.mask.any(axis=(0, 1)))
    z = (heights[-1] - np.arange(bone.mask.shape[2])) * dz - BELOW_TOP_MM
    upper = bone.mask[:, :, max(0, heights[-1] - int(100.0 / dz)) :]
    lengths = np.flatnonzero(upper.any(axis=(0, 2)))
    j = np.arange(bone.mask.shape[1])
    ends = {1: (lengths[-1] - j) * dy, -1: (j - lengths[0]) * dy}
    wished = [ends[bone.back]] if bone.back else [ends[1], ends[-1]]
    y = np.min([np.abs(end - BEFORE_BACK_MM) for end in wished], axis=0)
    return (y[:, None] ** 2 + z[None, :] ** 2) / WISH_MM**2
