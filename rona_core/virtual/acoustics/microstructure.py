"""Structure of the bone besides its smooth shape: frozen in the skull, the same at every visit.

Roughness of the boundaries and speckle of the diploe are fields between hashed numbers at the nodes
of a lattice, so neighbouring A-scans meet overlapping ones and no random state is carried along.
What is finer than the lattice sends nothing back into the beam, and is a loss. The local speed of
sound is a smooth field: a sum of plane waves of random direction and phase. All of it is ground
truth, unknown to the detection of echoes.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from rona_core.geometry.arrays import Floats, readonly

CELL_MM = 0.6  # across the skull, of grains that are independent of their neighbours
NODE_MM, RMS = 1.2, 0.44  # of the lattice, and of the field between its nodes that is as loud
CORNERS = np.array(np.meshgrid((0, 1), (0, 1), (0, 1), indexing="ij")).reshape(3, 8).T
AXIAL_CELL_MM = 0.15
UNIFORM_RMS_ONE = np.sqrt(12.0)  # a uniform number of width 1, scaled to rms 1
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
LENGTH_MM = 20.0  # typical wavelength over two of the field of the speed
WAVES = 24
LEAST = 0.8  # no place is slower than this share of the mean
Singles = NDArray[np.float32]
STREAM = 0x5BEED  # names the share of the field of the speed in the session's seed


def _scramble(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return a well mixed 64-bit number (splitmix64, Steele 2014)."""
    with np.errstate(over="ignore"):
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return x ^ (x >> np.uint64(31))


def texture(points_skull: Floats, seed: int, layers: int) -> Singles:
    """Return random fields (n, layers) at points (n, 3): smooth across the skull, white in depth.

    Each is interpolated between the hashed numbers of the nodes around, so it belongs to the
    bone, and any set of rays closer than the nodes meets the same. Under a beam it echoes as loud
    as numbers of rms 1 for cells of ``CELL_MM`` across would.
    """
    place = points_skull / NODE_MM
    low = np.floor(place)
    share = place - low
    share *= share * (3.0 - 2.0 * share)
    weights = np.where(CORNERS, share[:, None], 1.0 - share[:, None]).prod(axis=2)  # (n, 8)
    weights *= RMS / np.sqrt(np.sum(weights**2, axis=1, keepdims=True))
    nodes = low[:, None].astype(np.int64) + CORNERS  # (n, 8, 3)
    keys, node = np.unique(_keys(nodes.reshape(-1, 3), seed), return_inverse=True)
    starts = np.arange(0, 8 * len(place) + 1, 8)
    shape = len(place), len(keys)
    between = csr_array((weights.astype(np.float32).ravel(), node.ravel(), starts), shape=shape)
    return np.asarray(between @ _white(keys, layers))


def _keys(nodes: NDArray[np.int64], seed: int) -> NDArray[np.uint64]:
    """Return one key (n,) for each node (n, 3) of the lattice in the skull."""
    with np.errstate(over="ignore"):
        key = _scramble(np.full(len(nodes), seed % 2**63, dtype=np.uint64) + GOLDEN)
        for column in nodes.view(np.uint64).T:
            key = _scramble(key ^ (column * GOLDEN + np.uint64(1)))
    return key


def _white(keys: NDArray[np.uint64], layers: int) -> Singles:
    """Return uniform numbers (n, layers) of mean 0 and rms 1, four from each hash of a key."""
    with np.errstate(over="ignore"):
        turn = (np.arange(1, -(-layers // 4) + 1, dtype=np.uint64) * GOLDEN)[None, :]
        mixed = _scramble(keys[:, None] + turn)
    share = mixed.view(np.uint16)[:, :layers].astype(np.float32)
    share -= np.float32((2**16 - 1) / 2.0)
    share *= np.float32(UNIFORM_RMS_ONE / 2**16)
    return share


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
