"""What is measured beside the robot: a caliper on the bone, and the probe on a block of steel."""

from dataclasses import replace

import numpy as np

from rona_core.devices.samples import AScan, AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DeviceError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.probe.materials import Material
from rona_core.virtual.acoustics.medium import Medium
from rona_core.virtual.acoustics.probe import VirtualProbe
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.noise import rng
from rona_core.virtual.scene import VirtualScene

STEEL = Material(5.9, 7.8, shear_mm_per_us=3.2)
PART_MM = 10.0  # the model counts the block as three layers of one material
PERIOD_S = 0.02
CALIPER_SIGMA_MM = 0.1
BEHIND_MM = 10.0  # rays start this far outside the place


class SteelFace:
    """A plane z = 0 with steel behind it; asked like any specimen."""

    def layers(self, origins_skull: Floats, directions_skull: Floats) -> Floats:
        """Return distances (n, 4) along rays to the face and to three planes in the steel."""
        depths = PART_MM * np.arange(4)
        return (depths - origins_skull[:, 2:]) / directions_skull[:, 2:]


def steel_medium() -> Medium:
    """Return gel on steel, without texture and without another side."""
    return Medium(
        table=STEEL,
        diploe=STEEL,
        brain=STEEL,
        ramp_mm=0.0,
        outer_roughness_mm=0.0,
        inner_roughness_mm=0.0,
        speckle=0.0,
    )


def record_block(settings: ProbeSettings, n: int, seed: int, ordinal: int = 0) -> AScanTrack:
    """Return ``n`` A-scans of the block with the probe set down on it, perpendicular.

    The line is as warm as the settings say, and gel fills the film that always remains.
    """
    clock = CaptureClock()
    probe = VirtualProbe(clock, Pose.identity, SteelFace(), steel_medium())
    probe.begin(settings, seed, ordinal)
    scans: list[AScan] = []
    for number in range(n):
        clock.wait_until(PERIOD_S * (number + 1))
        scans.append(probe.acquire())
    probe.close()
    return AScanTrack.from_scans(scans)


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
