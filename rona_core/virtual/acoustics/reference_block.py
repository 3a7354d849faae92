"""A thick block of steel under the virtual probe: what a laboratory calibrates its delay line on.

The block is so thick, or its back so rough, that only its face echoes.
"""

import numpy as np

from rona_core.devices.samples import AScan, AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.probe.materials import Material
from rona_core.virtual.acoustics.medium import Medium
from rona_core.virtual.acoustics.probe import VirtualProbe
from rona_core.virtual.clock import CaptureClock

STEEL = Material(5.9, 7.8, shear_mm_per_us=3.2)
PART_MM = 10.0  # the model counts the block as three layers of one material
PERIOD_S = 0.02


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
