"""Echo volume: amplitudes of all A-scans on one grid in the frame of the maps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap

SILENCE = 1e-6  # amplitude that stands for none, where a logarithm is taken
NOISE_MM = 2.0  # at the bottom of a volume, below any inner boundary, there is noise alone


@dataclass(frozen=True, slots=True, eq=False)
class EchoVolume:
    """Linear echo amplitude over the columns (nu, nv) of a map and the heights (nz,) of its z axis.

    1 is the front echo of flat bone in perfect contact. Voxels that are neither ``measured`` nor
    ``filled`` are not known, and 0.
    """

    outer: BoundaryMap  # of the same columns: frame, places, and height of the front echo
    z_mm: Floats  # (nz,) ascending, out of the bone, even
    amplitude: NDArray[np.float32]  # (nu, nv, nz)
    measured: Bools  # (nu, nv, nz) an A-scan passes within a cell
    filled: Bools  # (nu, nv, nz) a hole that was filled from measured voxels
    blind_mm: float  # below the outer boundary; so deep the front echo hides what lies there
    deepest_mm: float  # below the outer boundary; no voxel is known further down

    @property
    def T_base_map(self) -> Pose:
        """Return the frame of the grid, z out of the bone."""
        return self.outer.T_base_map

    @property
    def known(self) -> Bools:
        """Return which voxels (nu, nv, nz) hold an amplitude."""
        return self.measured | self.filled

    @property
    def steps_mm(self) -> tuple[float, float, float]:
        """Return the size of a voxel along u, v and z."""
        u, v, z = self.outer.u_mm, self.outer.v_mm, self.z_mm
        return float(u[1] - u[0]), float(v[1] - v[0]), float(z[1] - z[0])

    def depths_mm(self) -> Floats:
        """Return how far below the outer boundary each voxel lies (nu, nv, nz), along z."""
        return self.outer.height_mm[:, :, None] - self.z_mm

    def level_db(self, gain_db_per_mm: float = 0.0) -> NDArray[np.float32]:
        """Return the levels (nu, nv, nz) in dB, raised by a gain with depth (time-gain control).

        Args:
            gain_db_per_mm: For each mm below the outer boundary; nothing is raised above it.
        """
        level = 20.0 * np.log10(np.maximum(self.amplitude, SILENCE))
        if gain_db_per_mm:
            level = level + gain_db_per_mm * np.clip(self.depths_mm(), 0.0, self.deepest_mm)
        return level.astype(np.float32)

    def noise(self) -> float:
        """Return the median amplitude below the thickest bone; 0 where nothing is known there."""
        depths = self.depths_mm()
        deep = self.known & (depths > self.deepest_mm - NOISE_MM) & (depths <= self.deepest_mm)
        return float(np.median(self.amplitude[deep])) if deep.any() else 0.0
