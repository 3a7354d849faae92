"""What is measured beside the robot: a caliper on the bone, and the probe on a block of steel."""

from dataclasses import replace

import numpy as np

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Floats
from rona_core.virtual.acoustics.reference_block import record_block
from rona_core.virtual.noise import rng
from rona_core.virtual.scene import VirtualScene

CALIPER_SIGMA_MM = 0.1
BEHIND_MM = 10.0  # rays start this far outside the place


class VirtualBench:
    """Measures on the true bone, with the error of a caliper; satisfies ``devices.Bench``."""

    def __init__(self, scene: VirtualScene) -> None:
        """Measure in this scene."""
        self.begin(scene, 0)

    def begin(self, scene: VirtualScene, ordinal: int) -> None:
        """Get ready for capture number ``ordinal``."""
        self._scene, self._ordinal, self._block = scene, ordinal, 0

    def measure_thickness(self, places_base: Floats, axes_base: Floats) -> tuple[Floats, float]:
        """Return thicknesses (n,) of the bone at places along inward axes (n, 3), and their sigma.

        Raises:
            DeviceError: a place where a caliper finds no bone to grip.
        """
        T_skull_base = self._scene.T_base_skull.inv()
        starts = T_skull_base @ (places_base - BEHIND_MM * axes_base)
        found = self._scene.specimen.layers(starts, T_skull_base.rotate(axes_base))
        true_mm = found[:, 3] - found[:, 0]
        if not np.isfinite(true_mm).all():
            row = int(np.flatnonzero(~np.isfinite(true_mm))[0])
            raise DeviceError(f"there is no bone at place {row + 1} that a caliper could grip")
        random = rng(self._scene.seed, "caliper", self._ordinal, 0)
        return true_mm + random.normal(0.0, CALIPER_SIGMA_MM, len(true_mm)), CALIPER_SIGMA_MM

    def record_reference_block(
        self, settings: ProbeSettings, temperature_c: float, n: int
    ) -> AScanTrack:
        """Return ``n`` A-scans of the probe at rest on a steel block, its line this warm."""
        warm = replace(settings, line_temperature_c=temperature_c)
        self._block += 1
        ordinal = 1000 * self._ordinal + self._block  # noise of its own for each temperature
        return record_block(warm, n, self._scene.seed, ordinal)
