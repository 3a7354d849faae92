"""Triangulation error of a stereo camera: how it grows with depth over a measuring volume.

For parallel cameras of focal length f and baseline b that find image points to s pixels,
triangulation gives, at depth z,

    lateral:  z s / (sqrt(2) f)          depth:  sqrt(2) z^2 s / (f b)

so that depth over lateral is 2 z / b. Real trackers do better in depth than their housing suggests;
therefore the ratio is chosen, and b is what belongs to it.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rona_core.devices.trackers import Volume
from rona_core.geometry.arrays import Floats, readonly

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
    return readonly(points[volume.contains(points)])
