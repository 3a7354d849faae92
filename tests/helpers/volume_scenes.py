"""A-scans of known bone as lines whose profiles are two bells: the input of an echo volume.

The inner bell is made in bone whose loss is the one that the ridge makes up for.
"""

import numpy as np

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


def profiles(thickness_mm, *, speed=SPEED_MM_PER_US, inner=INNER):
    """Return profiles with a front echo of 1 and an inner one so deep along each line (n,)."""
    loss = GAIN_DB_PER_MM / 20.0 * np.log(10.0)  # per mm
    lag_us = FIRST_US + STEP_US * np.arange(400)
    along = lag_us * speed / 2.0
    behind = along - np.asarray(thickness_mm)[:, None]
    bells = np.exp(-0.5 * (along / WIDTH_MM) ** 2) + inner * np.exp(
        -0.5 * (behind / WIDTH_MM) ** 2 - loss * np.maximum(along, 0.0)
    )
    return EchoProfiles(FIRST_US, STEP_US, bells.astype(np.float32))


def meander(width_mm=20.0, rows_mm=2.0, pitch_mm=1.0, aside_mm=0.0):
    """Return places (n, 2) on rows over a square."""
    half = width_mm / 2
    along, across = np.arange(-half, half + 1e-9, pitch_mm), np.arange(-half, half + 1e-9, rows_mm)
    return np.array([(x, y) for y in across for x in along]) + aside_mm


def outer_map(heights, *, half_mm=12.0, cell_mm=1.0, T_base_map=T_BASE_MAP):
    """Return a map of the outer boundary z(places (n, 2)) whose cells are all mapped."""
    axis = np.arange(-half_mm, half_mm + 1e-9, cell_mm)
    u, v = np.meshgrid(axis, axis, indexing="ij")
    z = heights(np.column_stack((u.ravel(), v.ravel()))).reshape(u.shape)
    return BoundaryMap(T_base_map, axis, axis, z, np.ones(u.shape, dtype=np.bool_))


def plate(thickness_mm=6.0, slope=(0.0, 0.0), *, speed=SPEED_MM_PER_US, **places):
    """Return lines at right angles to the map through a plate z = slope . (u, v), and its map."""
    xy = meander(**places)
    n, slope = len(xy), np.array(slope)
    outer = outer_map(lambda at: at @ slope)
    points = T_BASE_MAP @ np.column_stack((xy, xy @ slope))
    axes = T_BASE_MAP.rotate(np.tile((0.0, 0.0, -1.0), (n, 1)))
    held = profiles(np.full(n, thickness_mm), speed=speed)
    return ScanLines(points, axes, np.full(n, speed), held), outer


def dome(radius_mm=80.0, thickness_mm=5.0, **places):
    """Return lines towards the centre of concentric spheres, whose top is the origin of the map."""
    xy = meander(**places)

    def heights(at):
        return np.sqrt(radius_mm**2 - (at**2).sum(axis=1)) - radius_mm

    points = np.column_stack((xy, heights(xy)))
    axes = (0.0, 0.0, -radius_mm) - points
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    lines = ScanLines(
        T_BASE_MAP @ points,
        T_BASE_MAP.rotate(axes),
        np.full(len(xy), SPEED_MM_PER_US),
        profiles(np.full(len(xy), thickness_mm)),
    )
    return lines, outer_map(heights)
