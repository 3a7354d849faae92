"""A-scans of known bone as lines whose profiles are two bells: the input of an echo volume.

The inner bell is made in bone whose loss is the one that the ridge makes up for.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.volume.inner_ridge import GAIN_DB_PER_MM
from rona_core.mapping.volume.reconstruction import ScanLines
from rona_core.ultrasound.detection.echo_profiles import EchoProfiles
from rona_core.ultrasound.probe.probe_model import probe_model

PROBE = probe_model("2.25MHz")
T_BASE_MAP = Pose.from_rotvec((2.1, -0.8, 0.4), (620.0, -140.0, 310.0))
SPEED_MM_PER_US, STEP_US, FIRST_US = 2.7, 0.04, -3.0
WIDTH_MM = 0.5  # standard deviation of a bell
INNER = 0.2  # amplitude of the inner echo without the loss on its way


def profiles(thickness_mm: ArrayLike) -> EchoProfiles:
    """Return profiles with a front echo of 1 and an inner one so deep along each line (n,)."""
    loss = GAIN_DB_PER_MM / 20.0 * np.log(10.0)  # per mm
    lag_us = FIRST_US + STEP_US * np.arange(400)
    along = lag_us * SPEED_MM_PER_US / 2.0
    behind = along - np.asarray(thickness_mm)[:, None]
    bells = np.exp(-0.5 * (along / WIDTH_MM) ** 2) + INNER * np.exp(
        -0.5 * (behind / WIDTH_MM) ** 2 - loss * np.maximum(along, 0.0)
    )
    return EchoProfiles(FIRST_US, STEP_US, bells.astype(np.float32))


def meander(
    width_mm: float = 20.0, rows_mm: float = 2.0, pitch_mm: float = 1.0, aside_mm: float = 0.0
) -> Floats:
    """Return places (n, 2) on rows over a square."""
    half = width_mm / 2
    along, across = np.arange(-half, half + 1e-9, pitch_mm), np.arange(-half, half + 1e-9, rows_mm)
    return np.array([(x, y) for y in across for x in along]) + aside_mm


def outer_map(heights: Callable[[Floats], Floats], *, half_mm: float = 12.0) -> BoundaryMap:
    """Return a map of the outer boundary z(places (n, 2)) whose cells are all mapped."""
    axis = np.arange(-half_mm, half_mm + 1e-9, 1.0)
    u, v = np.meshgrid(axis, axis, indexing="ij")
    z = heights(np.column_stack((u.ravel(), v.ravel()))).reshape(u.shape)
    return BoundaryMap(T_BASE_MAP, axis, axis, z, np.ones(u.shape, dtype=np.bool_))


def plate(
    thickness_mm: float = 6.0, slope: tuple[float, float] = (0.0, 0.0), rows_mm: float = 2.0
) -> tuple[ScanLines, BoundaryMap]:
    """Return lines at right angles to the map through a plate z = slope . (u, v), and its map."""
    xy = meander(rows_mm=rows_mm)
    n, rise = len(xy), np.array(slope)

    def heights(at: Floats) -> Floats:
        return at @ rise

    points = T_BASE_MAP @ np.column_stack((xy, heights(xy)))
    axes = T_BASE_MAP.rotate(np.tile((0.0, 0.0, -1.0), (n, 1)))
    speeds, held = np.full(n, SPEED_MM_PER_US), profiles(np.full(n, thickness_mm))
    return ScanLines(points, axes, speeds, held), outer_map(heights)


def dome(
    radius_mm: float = 80.0, thickness_mm: float = 5.0, aside_mm: float = 0.0
) -> tuple[ScanLines, BoundaryMap]:
    """Return lines towards the centre of concentric spheres, whose top is the origin of the map."""
    xy = meander(aside_mm=aside_mm)

    def heights(at: Floats) -> Floats:
        return np.sqrt(radius_mm**2 - np.sum(at**2, axis=1)) - radius_mm

    points = np.column_stack((xy, heights(xy)))
    axes = np.array((0.0, 0.0, -radius_mm)) - points
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    lines = ScanLines(
        T_BASE_MAP @ points,
        T_BASE_MAP.rotate(axes),
        np.full(len(xy), SPEED_MM_PER_US),
        profiles(np.full(len(xy), thickness_mm)),
    )
    return lines, outer_map(heights)
