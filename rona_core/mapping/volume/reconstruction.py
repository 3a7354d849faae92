"""Volume reconstruction: A-scans as lines in space, compounded on the grid of the maps.

Linear interpolation, mean compounding and filling of holes, in the words of PLUS (Lasso et al.
2014, see docs/references.md). What the other choices cost: docs/algorithms/maps/echo_volume.md.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_floats, as_points, as_unit_vectors, readonly
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.map_grid import NEAR_MM
from rona_core.mapping.volume.echo_volume import EchoVolume
from rona_core.ultrasound.detection.echo_profiles import ABOVE_MM, EchoProfiles, deepest_mm
from rona_core.ultrasound.probe.materials import GEL
from rona_core.ultrasound.probe.probe_model import ProbeModel


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


DEPTH_STEPS_MM = (0.1, 1.0)
FILL_RADII_MM = (0.0, 10.0)
LEAST_COSINE = 0.5  # between the probe axis and the normal of the map: it leans 60 degrees
MOST_VOXELS = 20_000_000
LEAST_SHARE = 0.01  # of a sample; a column that gets less is none that the line passes
BLIND_SHARE = 1.25  # of the thinnest bone that a probe resolves, in which its front echo lingers


@dataclass(frozen=True, slots=True)
class VolumeSettings:
    """Height of a voxel, and radius within which holes are filled.

    Raises:
        InvalidInputError: one of them is out of its range.
    """

    depth_step_mm: float = 0.25
    fill_radius_mm: float = NEAR_MM  # as far as the maps reach

    def __post_init__(self) -> None:
        for name, value, (low, high) in (
            ("depth_step_mm", self.depth_step_mm, DEPTH_STEPS_MM),
            ("fill_radius_mm", self.fill_radius_mm, FILL_RADII_MM),
        ):
            if not low <= value <= high:
                raise InvalidInputError(f"{name} must be {low:g} to {high:g}: {value:g}")


@dataclass(frozen=True, slots=True, eq=False)
class ScanLines:
    """A-scans (n) as lines in ``base``, each with the profile of its echoes.

    Raises:
        InvalidInputError: numbers of lines differ, values that are not finite, a speed of 0.
    """

    outer_points_base: Floats  # (n, 3) where the line enters the bone
    axes_base: Floats  # (n, 3) of the probe, into the bone
    speeds_mm_per_us: Floats  # (n,) of sound in the bone
    profiles: EchoProfiles

    def __post_init__(self) -> None:
        as_points(self.outer_points_base, name="outer points")
        as_unit_vectors(self.axes_base, name="axes")
        speeds = as_floats(self.speeds_mm_per_us, name="speeds")
        numbers = (len(self.outer_points_base), len(self.axes_base), *speeds.shape)
        if numbers != (len(self.profiles),) * 3:
            raise InvalidInputError(
                f"{len(self.profiles)} profiles need as many outer points, axes and speeds, "
                f"not {', '.join(map(str, numbers))}"
            )
        if not (speeds > 0.0).all():
            raise InvalidInputError("the speed of sound of every line must be above 0 mm/us")


def reconstruct_volume(
    lines: ScanLines,
    outer: BoundaryMap,
    probe: ProbeModel,
    settings: VolumeSettings | None = None,
) -> EchoVolume:
    """Return the echo amplitudes of all lines over the columns of a map.

    Each line gives one sample to every height of the grid that it crosses: its profile at the time
    of that place, with the speed of gel above the outer boundary and of bone below it. The four
    columns about the place share it by their distance (linear interpolation); a voxel holds the
    mean of its samples (compounding).

    Args:
        lines: The A-scans.
        outer: Map of the outer boundary, made of the same A-scans.
        probe: That took them.
        settings: Of the grid and its holes; None: the usual ones.

    Raises:
        InvalidInputError: the grid would have too many voxels.
        DegenerateGeometryError: no line, none that goes down through the map, or a map that is one
            row of cells.
    """
    wanted, deepest = settings or VolumeSettings(), deepest_mm(probe)
    z_mm = _heights(outer, deepest, wanted.depth_step_mm)
    T_map_base = outer.T_base_map.inv()
    points, axes = T_map_base @ lines.outer_points_base, T_map_base.rotate(lines.axes_base)
    if not (axes[:, 2] <= -LEAST_COSINE).any():
        raise DegenerateGeometryError(
            f"none of {len(axes)} A-scans goes down through the map: an echo volume needs A-scans "
            "with an outer boundary, of the same scan as the map"
        )
    along = (z_mm - points[:, 2:]) / np.minimum(axes[:, 2:], -LEAST_COSINE)  # (n, nz), mm
    bone = lines.speeds_mm_per_us[:, None]
    lags_us = 2.0 * along / np.where(along < 0.0, GEL.speed_mm_per_us, bone)
    there = (along >= -ABOVE_MM) & (along <= deepest) & (axes[:, 2:] <= -LEAST_COSINE)
    places = points[:, None, :2] + along[:, :, None] * axes[:, None, :2]
    total, weight = _compounded(lines.profiles.at(lags_us), there, places, outer)
    measured = weight > 0.0
    mean = np.divide(total, weight, out=np.zeros(weight.shape), where=measured).astype(np.float32)
    cell_u, cell_v = (float(axis[1] - axis[0]) for axis in (outer.u_mm, outer.v_mm))
    amplitude, filled = fill_holes(
        mean,
        measured,
        outer.height_mm,
        steps_mm=(cell_u, cell_v, wanted.depth_step_mm),
        radius_mm=wanted.fill_radius_mm,
    )
    blind = BLIND_SHARE * probe.min_thickness_mm
    for array in (amplitude, measured, filled):
        array.setflags(write=False)
    return EchoVolume(outer, readonly(z_mm), amplitude, measured, filled, blind, deepest)


def _heights(outer: BoundaryMap, deepest: float, step_mm: float) -> Floats:
    """Return the heights (nz,) of a grid from above the outer boundary to below the bone."""
    if min(outer.height_mm.shape) < 2 or not outer.ok.any():
        raise DegenerateGeometryError(
            f"the map has {outer.height_mm.shape} cells, of which {int(outer.ok.sum())} are "
            "mapped: an echo volume needs an area"
        )
    heights = outer.height_mm[outer.ok]
    low = np.floor((float(heights.min()) - deepest) / step_mm)
    high = np.ceil((float(heights.max()) + ABOVE_MM) / step_mm)
    voxels = outer.height_mm.size * (high - low + 1)
    if voxels > MOST_VOXELS:
        raise InvalidInputError(
            f"the volume would have {voxels:.3g} voxels, {MOST_VOXELS:.3g} are the most: "
            "take a larger depth_step_mm, or map with larger cells"
        )
    return np.arange(low, high + 1.0) * step_mm


def _compounded(
    values: Floats, there: np.ndarray, places: Floats, outer: BoundaryMap
) -> tuple[Floats, Floats]:
    """Return the weighted sum of samples and of their weights, both (nu, nv, nz).

    Args:
        values: Of n lines at nz heights (n, nz).
        there: Which of them count (n, nz).
        places: In the u-v plane of the map (n, nz, 2).
        outer: Its columns are meant.
    """
    u, v = outer.u_mm, outer.v_mm
    shape = (len(u), len(v), values.shape[1])
    heights = np.broadcast_to(np.arange(shape[2]), values.shape)
    column = [(places[..., k] - axis[0]) / (axis[1] - axis[0]) for k, axis in enumerate((u, v))]
    whole = [np.floor(place).astype(np.int64) for place in column]
    total, weight = np.zeros(shape).ravel(), np.zeros(shape).ravel()
    for corner in np.ndindex(2, 2):
        at = [low + step for low, step in zip(whole, corner, strict=True)]
        shares = [1.0 - np.abs(place - k) for place, k in zip(column, at, strict=True)]
        share = shares[0] * shares[1]
        inside = there & (share > LEAST_SHARE)
        for k, n in zip(at, shape[:2], strict=True):
            inside &= (k >= 0) & (k < n)
        voxel = np.ravel_multi_index((at[0][inside], at[1][inside], heights[inside]), shape)
        some = share[inside]
        total += np.bincount(voxel, some * values[inside], minlength=total.size)
        weight += np.bincount(voxel, some, minlength=weight.size)
    return total.reshape(shape), weight.reshape(shape)
