"""How the speed of sound varies over one skull: ground truth, unknown to the detection of echoes.

A smooth field frozen in the skull: a sum of plane waves of random direction and phase.
"""

from functools import lru_cache

import numpy as np

from rona_core.geometry.arrays import Floats, readonly

LENGTH_MM = 20.0  # typical wavelength over two of the field
WAVES = 24
LEAST = 0.8  # no place is slower than this share of the mean
STREAM = 0x5BEED  # names the share of this field in the session's seed


@lru_cache(maxsize=8)
def _waves(seed: int) -> tuple[Floats, Floats]:
    random = np.random.default_rng((seed, STREAM))
    direction = random.normal(size=(WAVES, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    length = 2.0 * LENGTH_MM * random.uniform(0.6, 1.8, WAVES)
    waves = 2.0 * np.pi / length[:, None] * direction
    return readonly(waves), readonly(random.uniform(0.0, 2.0 * np.pi, WAVES))


def local_speed_factors(points_skull: Floats, seed: int, sd: float) -> Floats:
    """Return the speed at points (n, 3) in ``skull`` over its mean; ``sd`` is its relative rms."""
    if sd == 0.0:
        return np.ones(len(points_skull))
    waves, phases = _waves(seed)
    field = np.sin(points_skull @ waves.T + phases).sum(axis=1) * np.sqrt(2.0 / WAVES)
    return np.maximum(1.0 + sd * field, LEAST)
