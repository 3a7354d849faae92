"""Structure of the bone besides its smooth shape: frozen in the skull, the same at every visit.

Roughness of the boundaries and speckle of the diploe are hashed from the cell of the skull that a
ray meets, so neighbouring A-scans see overlapping cells and no random state is carried along. The
local speed of sound is a smooth field: a sum of plane waves of random direction and phase. All of
it is ground truth, unknown to the detection of echoes.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Floats, readonly

LATERAL_CELL_MM = 0.6
AXIAL_CELL_MM = 0.15
UNIFORM_RMS_ONE = np.sqrt(12.0)  # a uniform number of width 1, scaled to rms 1
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
LENGTH_MM = 20.0  # typical wavelength over two of the field of the speed
WAVES = 24
LEAST = 0.8  # no place is slower than this share of the mean
STREAM = 0x5BEED  # names the share of the field of the speed in the session's seed


def _scramble(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return a well mixed 64-bit number (splitmix64, Steele 2014)."""
    with np.errstate(over="ignore"):
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return x ^ (x >> np.uint64(31))


def cells(entries_skull: Floats, seed: int) -> NDArray[np.uint64]:
    """Return one key (n,) for the cell of each entry point (n, 3) in the skull."""
    lattice = np.floor(entries_skull / LATERAL_CELL_MM).astype(np.int64).view(np.uint64)
    with np.errstate(over="ignore"):
        key = _scramble(np.full(len(lattice), seed % 2**63, dtype=np.uint64) + GOLDEN)
        for column in lattice.T:
            key = _scramble(key ^ (column * GOLDEN + np.uint64(1)))
    return key


def grains(keys: NDArray[np.uint64], layers: int) -> Floats:
    """Return uniform numbers (n, layers) of mean 0 and rms 1 for the cells ``keys`` (n,)."""
    with np.errstate(over="ignore"):
        depth = (np.arange(1, layers + 1, dtype=np.uint64) * GOLDEN)[None, :]
        mixed = _scramble(keys[:, None] + depth)
    return ((mixed >> np.uint64(11)).astype(np.float64) / 2.0**53 - 0.5) * UNIFORM_RMS_ONE


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
