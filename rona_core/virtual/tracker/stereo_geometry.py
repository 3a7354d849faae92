"""Two virtual cameras side by side: how exactly they place a point, by how far away it is.

For parallel cameras of focal length f and baseline b that find image points to s pixels,
triangulation gives, at depth z,

    lateral:  z s / (sqrt(2) f)          depth:  sqrt(2) z^2 s / (f b)

so that depth over lateral is 2 z / b. Real trackers do better in depth than their housing suggests;
therefore the ratio is chosen, and b is what belongs to it.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rona_core.devices.tracker_volumes import Volume
from rona_core.geometry.arrays import Floats

GRID = 48  # nodes a side of the grid that integrates over a volume


@dataclass(frozen=True, slots=True)
class Moments:
    """Root mean squares over a volume, evenly spread."""

    z_mm: float  # of the depth
    z2_mm2: float  # of its square

    def growth(self, points_tracker: Floats) -> Floats:
        """Return how the error goes with the place (n, 3): each axis has RMS 1 over the volume."""
        z = points_tracker[:, 2]
        lateral = z / self.z_mm
        return np.stack((lateral, lateral, z * z / self.z2_mm2), axis=1)


@dataclass(frozen=True, slots=True)
class StereoPair:
    """Two parallel cameras, at -b/2 and b/2 along x."""

    baseline_mm: float
    pixel_over_focal: float  # s / f, the error of a direction in radians

    def sigmas_mm(self, depths_mm: Floats) -> Floats:
        """Return the standard deviations (n, 3) along x, y and z at depths (n,)."""
        lateral = depths_mm * self.pixel_over_focal / np.sqrt(2.0)
        depth = np.sqrt(2.0) * depths_mm**2 * self.pixel_over_focal / self.baseline_mm
        return np.stack((lateral, lateral, depth), axis=1)


def stereo_pair(volume: Volume, depth_ratio: float, rms_mm: float) -> StereoPair:
    """Return the cameras with a 3D RMS error and a ratio of depth to lateral over a volume.

    Args:
        volume: Over which the RMS is taken, evenly.
        depth_ratio: RMS in depth over RMS in either lateral direction.
        rms_mm: 3D RMS.
    """
    moments = moments_of(volume)
    baseline_mm = 2.0 * moments.z2_mm2 / (moments.z_mm * depth_ratio)
    lateral_mm = rms_mm / np.sqrt(2.0 + depth_ratio**2)
    return StereoPair(baseline_mm, float(np.sqrt(2.0) * lateral_mm / moments.z_mm))


@lru_cache(maxsize=8)
def moments_of(volume: Volume) -> Moments:
    """Return the moments of a volume."""
    z = volume_grid(volume)[:, 2]
    return Moments(float(np.sqrt((z**2).mean())), float(np.sqrt((z**4).mean())))


@lru_cache(maxsize=4)
def volume_grid(volume: Volume, nodes: int = GRID) -> Floats:
    """Return points (n, 3) on a regular grid that fill a volume evenly."""
    half_x, half_y, low, high = volume.box()
    middles = (np.arange(nodes) + 0.5) / nodes
    x, y, z = (a.ravel() for a in np.meshgrid(middles, middles, middles, indexing="ij"))
    points = np.stack(
        ((2.0 * x - 1.0) * half_x, (2.0 * y - 1.0) * half_y, low + z * (high - low)), axis=1
    )
    return points[volume.contains(points)]
