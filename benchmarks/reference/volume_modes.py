"""Volume reconstruction line by line, in the modes of PLUS that RONA does not offer.

A second implementation of ``rona_core.mapping.volume.reconstruction``, for figures beside it.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.volume.echo_volume import EchoVolume
from rona_core.mapping.volume.reconstruction import ScanLines, fill_holes
from rona_core.ultrasound.probe.materials import GEL

Interpolation = Literal["nearest", "linear"]
Compounding = Literal["mean", "maximum", "latest"]
LEAST_SHARE = 0.01


def compounded(
    volume: EchoVolume, lines: ScanLines, interpolation: Interpolation, compounding: Compounding
) -> EchoVolume:
    """Return a volume on the grid of another one, made anew of its lines; holes stay open."""
    outer, z_mm = volume.outer, volume.z_mm
    T_map_base = outer.T_base_map.inv()
    points, axes = T_map_base @ lines.outer_points_base, T_map_base.rotate(lines.axes_base)
    shape = volume.amplitude.shape
    held, weight = np.zeros(shape), np.zeros(shape)
    for n in range(len(points)):
        along = (z_mm - points[n, 2]) / axes[n, 2]
        speed = np.where(along < 0.0, GEL.speed_mm_per_us, lines.speeds_mm_per_us[n])
        one = replace(lines.profiles, level=lines.profiles.level[n : n + 1])
        values = one.at((2.0 * along / speed)[None])[0]
        there = np.flatnonzero((along >= -2.0) & (along <= volume.deepest_mm))
        for i, j, k, share in _columns(points[n] + along[:, None] * axes[n], outer, interpolation):
            ok = np.isin(k, there) & (share > LEAST_SHARE)
            at = i[ok], j[ok], k[ok]
            if compounding == "mean":
                held[at] += share[ok] * values[k[ok]]
            elif compounding == "maximum":
                held[at] = np.maximum(held[at], values[k[ok]])
            else:
                held[at] = values[k[ok]]
            weight[at] += share[ok]
    measured = weight > 0.0
    mean = np.divide(held, weight, out=np.zeros(shape), where=measured)
    amplitude = (mean if compounding == "mean" else held).astype(np.float32)
    return replace(volume, amplitude=amplitude, measured=measured, filled=np.zeros_like(measured))


def filled(volume: EchoVolume, radius_mm: float, *, level: bool = False) -> EchoVolume:
    """Return a volume with its holes filled: along the outer boundary, or ``level`` at one height.

    Args:
        volume: With open holes.
        radius_mm: Within which columns count.
        level: Whether neighbours at the same height count, in place of those as deep.
    """
    heights = volume.outer.height_mm * (0.0 if level else 1.0)
    values, holes = fill_holes(
        volume.amplitude, volume.measured, heights, steps_mm=volume.steps_mm, radius_mm=radius_mm
    )
    return replace(volume, amplitude=values, filled=holes)


def _columns(
    places: Floats, outer: BoundaryMap, interpolation: Interpolation
) -> list[tuple[Ints, Ints, Ints, Floats]]:
    """Return columns (i, j), heights k and shares (m,) that a line through places (nz, 3) gives."""
    u, v = outer.u_mm, outer.v_mm
    a, b = (places[:, 0] - u[0]) / (u[1] - u[0]), (places[:, 1] - v[0]) / (v[1] - v[0])
    steps = ((0, 0),) if interpolation == "nearest" else ((0, 0), (0, 1), (1, 0), (1, 1))
    first = np.rint if interpolation == "nearest" else np.floor
    found: list[tuple[Ints, Ints, Ints, Floats]] = []
    for right, up in steps:
        i, j = first(a).astype(np.int64) + right, first(b).astype(np.int64) + up
        share = (1.0 - np.abs(a - i)) * (1.0 - np.abs(b - j))
        if interpolation == "nearest":
            share = np.ones(len(places))
        k = np.flatnonzero((i >= 0) & (i < len(u)) & (j >= 0) & (j < len(v)))
        found.append((i[k], j[k], k, share[k]))
    return found
