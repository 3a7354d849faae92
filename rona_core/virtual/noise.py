"""Random generators keyed by seed, device, capture and frame, independent of polling."""

import hashlib
from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from rona_core.geometry.arrays import Floats


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


class FrameNoise:
    """The generators ``rng(*stream, frame)`` of a stream, one after the other.

    One generator is set to each frame's place in turn, which is quicker than many.
    """

    def __init__(self, seed: int, device: str, ordinal: int) -> None:
        """Take the stream of one device in one capture."""
        self._generator = rng(seed, device, ordinal, 0)
        self._state = self._generator.bit_generator.state
        self._counter = self._state["state"]["counter"]

    def at(self, frame: int) -> np.random.Generator:
        """Return the generator of a frame; it is good until the next one is asked for."""
        self._counter[2] = int(frame) % 2**64
        self._generator.bit_generator.state = self._state
        return self._generator


def standard_normals(stream: tuple[int, str, int], frames: Iterable[int], count: int) -> Floats:
    """Return standard normal numbers (n, count): those of ``rng(*stream, frame)`` for n frames."""
    noise = FrameNoise(*stream)
    rows = [noise.at(frame).standard_normal(count) for frame in frames]
    return np.array(rows).reshape(-1, count)
