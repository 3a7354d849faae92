"""How hard a patient's bone is to cut, layer by layer, and how the force on the burr follows.

The outer table is the hardest (Peterson 2002: denser and stiffer than the inner one); the diploe
varies most (McElhaney 1970). Forces and noise themselves are assumed: no source gives them for a
ball burr in the calvaria.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats, readonly
from rona_core.virtual.noise import rng

SPECIFIC_N_PER_MM2 = 5.0  # of chip section in the outer table, at the feed below
SPECIFIC_SPREAD = 0.25  # of its logarithm: sharpness of the burr, and the patient
FULL_FEED_MM_PER_S = 4.0
FEED_POWER = 0.62  # thin chips cost more than thick ones, per volume
DIPLOE_RANGE = (0.25, 0.6)  # over the outer table
INNER_TABLE_RANGE = (0.85, 1.0)
DURA = 0.02
TEXTURE, TEXTURE_MM = 0.10, 3.0  # relative rms of the hardness from place to place; its length
WAVES = 24
SENSOR_N = 0.15  # rms of one reading
CHATTER = 0.12  # rms over the force in bone, as every tooth bites; soft tissue has none
READINGS_HZ = 100.0  # that are independent of each other


@dataclass(frozen=True, slots=True, eq=False)
class CuttingForce:
    """The force that one patient's bone puts up against the burr."""

    specific_n_per_mm2: float
    shares: Floats  # (4,) of outer table, diploe, inner table, dura
    waves_per_mm: Floats  # (k, 3) of the texture
    phases: Floats  # (k,)

    def of(self, areas_mm2: Floats, place_bed: Floats, feed_mm_per_s: float) -> float:
        """Return the mean force in N on a chip with so much section (4,) in each layer."""
        wave = np.cos(self.waves_per_mm @ place_bed + self.phases).sum()
        texture = 1.0 + TEXTURE * float(wave) * np.sqrt(2.0 / WAVES)
        feed = (feed_mm_per_s / FULL_FEED_MM_PER_S) ** FEED_POWER
        return float(self.specific_n_per_mm2 * texture * feed * (self.shares @ areas_mm2))


def draw_force(seed: int) -> CuttingForce:
    """Return the cutting force of the patient with this seed."""
    random = rng(seed, "cutting force", 0, 0)
    diploe, inner = random.uniform(*DIPLOE_RANGE), random.uniform(*INNER_TABLE_RANGE)
    return CuttingForce(
        float(SPECIFIC_N_PER_MM2 * np.exp(random.normal(0.0, SPECIFIC_SPREAD))),
        readonly(np.array((1.0, diploe, inner, DURA))),
        readonly(random.normal(0.0, 1.0 / TEXTURE_MM, (WAVES, 3))),
        readonly(random.uniform(0.0, 2.0 * np.pi, WAVES)),
    )


def measured(
    force_n: float, bone_n: float, duration_s: float, random: np.random.Generator
) -> tuple[float, float]:
    """Return mean and sigma of the readings of a force over some time.

    Args:
        force_n: True mean.
        bone_n: What of it comes from bone: that part alone chatters.
        duration_s: How long it is read.
        random: For the noise.
    """
    sigma = float(np.hypot(SENSOR_N, CHATTER * bone_n))
    count = max(READINGS_HZ * duration_s, 2.0)
    mean = force_n + random.normal(0.0, sigma / np.sqrt(count))
    spread = sigma * np.sqrt(random.chisquare(count) / count)
    return float(mean), float(spread)
