"""Reader of a whole HDF5 file: datasets by their path, attributes as ``path@name``.

It runs in a process of its own (``reader_process``), follows no links, and is bounded.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rona_core.devices.files.arrays import HDF5_MAGIC, MAX_VALUES, REAL
from rona_core.devices.files.reader_process import Found, read_apart, require_size
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError

MOST_PARTS = 20_000  # datasets and attributes
MOST_DEPTH = 12
MOST_LETTERS = 1000  # of a text


def read_hdf5_tree(file: NamedFile) -> Found:
    """Return all arrays of numbers, and all attributes that are numbers or texts.

    Raises:
        InvalidInputError: no HDF5, damaged, or with more than is taken.
    """
    if not file.data.startswith(HDF5_MAGIC):
        raise InvalidInputError(f"{file.name} is no HDF5 file")
    return read_apart(_read, file.data, file.name, "HDF5")


def _read(path: Path, name: str) -> Found:
    import h5py

    found: Found = {}
    with h5py.File(path, "r") as file:
        for place, value in _parts(file, "", 0):
            if len(found) >= MOST_PARTS:
                raise InvalidInputError(f"{name} has more than {MOST_PARTS} parts")
            if isinstance(value, h5py.Dataset):
                if value.external or value.is_virtual:
                    raise InvalidInputError(f"{name}: {place} lies in another file")
                if value.dtype.kind not in REAL:
                    continue
                for shape in (value.shape, value.chunks or ()):
                    require_size(tuple(shape), MAX_VALUES, f"{name}: {place}")
                found[place] = np.asarray(value[()])
            elif (kept := _attribute(value)) is not None:
                found[place] = kept
    return found


def _parts(group: Any, path: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield the datasets and attributes below a group."""
    import h5py

    for key in group.attrs:
        held = group.attrs.get_id(key)
        require_size(tuple(held.shape or ()), MOST_LETTERS, f"{path}@{key}")
        yield f"{path}@{key}", group.attrs[key]
    if depth >= MOST_DEPTH:
        return
    for key in group:
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            continue
        place = f"{path}/{key}" if path else str(key)
        item = group[key]
        if isinstance(item, h5py.Group):
            yield from _parts(item, place, depth + 1)
        elif isinstance(item, h5py.Dataset):
            yield place, item


def _attribute(value: Any) -> Any:
    """Return an attribute as an array of numbers or of letters; None where it is neither."""
    if isinstance(value, str | bytes):
        text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
        return np.array(text[:MOST_LETTERS])
    array = np.asarray(value)
    if array.dtype.kind == "O" and all(isinstance(one, str) for one in array.ravel()):
        return np.array([str(one)[:MOST_LETTERS] for one in array.ravel()])
    return array if array.dtype.kind in f"{REAL}U" else None
