"""Random generators keyed by seed, device, capture and frame, independent of polling."""

import hashlib
from functools import lru_cache

import numpy as np


def rng(seed: int, device: str, ordinal: int, frame: int) -> np.random.Generator:
    """Return the generator that belongs to one frame of one device in one capture.

    The same four values give the same numbers on every machine and in every process. Streams of
    different frames never overlap: the frame number is the upper half of Philox's counter.

    Args:
        seed: Seed of the session, any integer.
        device: Name of the device or quantity, e.g. ``"tracker"``.
        ordinal: Number of the capture.
        frame: Number of the frame, any integer.
    """
    counter = np.array((0, 0, frame % 2**64, 0), dtype=np.uint64)
    return np.random.Generator(np.random.Philox(counter=counter, key=_key(seed, device, ordinal)))


@lru_cache(maxsize=4096)
def _key(seed: int, device: str, ordinal: int) -> int:
    text = f"{int(seed)}|{device}|{int(ordinal)}".encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=16).digest(), "little")
