"""Layers of a volume of voxels, as they are read from its file."""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.files.voxels.refusals import refused
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats

MOST_VOXELS = 160_000_000
SLAB_BYTES = 16 * 1024**2
UNREAD = "could not be read as "


@dataclass(frozen=True, slots=True, eq=False)
class Voxels:
    """Shape and place of a volume, and its layers along the third axis, once."""

    shape: tuple[int, int, int]
    T_mesh_voxel: Floats  # (4, 4): coordinates of an index, in mm
    back: int  # +1 if y grows to the back of the head, -1 to the front, 0 unknown
    slabs: Iterator[NDArray[Any]]  # (nx, ny, some) each, from the first layer to the last


def checked_shape(name: str, shape: tuple[int, ...]) -> tuple[int, int, int]:
    """Return the shape of a volume; raises an InvalidInputError for what is none, or too large."""
    if len(shape) != 3 or min(shape) < 8:
        raise refused("no single volume", name=name, shape=shape)
    if shape[0] * shape[1] * shape[2] > MOST_VOXELS:
        raise refused("too many voxels", name=name, shape=shape, most=MOST_VOXELS / 1e6)
    return shape[0], shape[1], shape[2]


def layers_of(
    read: Callable[[int], bytes],
    shape: tuple[int, int, int],
    dtype: np.dtype[Any],
    name: str,
    *,
    to_the_end: bool,
) -> Generator[NDArray[Any]]:
    """Yield layers of voxels that are stored first axis first."""
    layer = shape[0] * shape[1] * dtype.itemsize
    at_once = max(1, SLAB_BYTES // layer)
    for k in range(0, shape[2], at_once):
        count = min(at_once, shape[2] - k)
        data = bytearray()
        while len(data) < count * layer and (part := read(count * layer - len(data))):
            data += part
        if len(data) < count * layer:
            raise InvalidInputError(too_short(name))
        yield np.frombuffer(data, dtype).reshape(*shape[:2], count, order="F")
    if to_the_end and read(1):
        raise InvalidInputError(too_long(name))


def too_short(name: str) -> str:
    """Return the words for a file that ends too early."""
    return (
        f"{name} {UNREAD}{kind_of(name)}: it has fewer voxels than its header says; export it again"
    )


def too_long(name: str) -> str:
    """Return the words for a file that goes on."""
    return f"{name} {UNREAD}{kind_of(name)}: it has more voxels than it says; export it again"


def kind_of(name: str) -> str:
    """Return which format the ending of a name says."""
    return "NRRD" if name.lower().endswith(".nrrd") else "NIfTI"
