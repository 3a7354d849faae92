"""Reader of named arrays in HDF5, MATLAB and numpy files.

HDF5 and MATLAB files are read in a process of their own: their libraries crash on damaged ones,
and are imported there alone.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rona_core.devices.files.npy import MAX_HEADER_BYTES, array_from_npy, array_header
from rona_core.devices.files.reader_process import Found, read_apart, require_size
from rona_core.devices.files.size_limits import open_zip, read_member
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError

RF = ("rf", "fs", "t0", "positions")
HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
ZIP_MAGIC = b"PK\x03\x04"
MATLAB_MAGIC = b"MATLAB 5"
MATLAB_73_MAGIC = b"MATLAB 7.3"
MAGICS = (HDF5_MAGIC, ZIP_MAGIC, MATLAB_MAGIC)
MAX_VALUES = 32_000_000  # of one array: 256 MB as float64
REAL = "iufb"
REFUSED_HDF5 = "lies in another file: expected it in this one"


def read_arrays(file: NamedFile, *, all_of_them: bool = False) -> Mapping[str, Any]:
    """Return the arrays of a file, recognised by its content, not by its name.

    All of them, or where ``rf`` and ``fs`` are there those of ``RF``, else all names, for the
    message.

    Raises:
        InvalidInputError: another kind of file, damaged, or one with too many values.
    """
    data = file.data
    # MATLAB 7.3 puts 512 bytes of its own before HDF5
    if HDF5_MAGIC in (data[:8], data[512:520]):
        reader = read_all_of_hdf5 if all_of_them else read_hdf5
        return _known(read_apart(reader, data, file.name, "HDF5"), all_of_them)
    if data.startswith(ZIP_MAGIC):
        return _known(_from_npz(file, all_of_them), all_of_them)
    if data.startswith(MATLAB_MAGIC):
        reader = read_all_of_matlab if all_of_them else read_matlab
        return _known(read_apart(reader, data, file.name, "MATLAB"), all_of_them)
    if not data:
        raise InvalidInputError(f"{file.name} is empty: expected an HDF5, .mat or .npz file")
    raise InvalidInputError(
        f"{file.name} is no HDF5, MATLAB (.mat) or numpy (.npz) file: expected one of these with "
        "rf (scans, samples) and fs in Hz"
    )


def _known(found: Found, all_of_them: bool) -> Found:
    """Return the arrays; other names stay, without contents, for the message."""
    if not all_of_them and "rf" in found and "fs" in found:
        return {key: found[key] for key in RF if key in found}
    return found


def read_all_of_hdf5(path: Path, name: str) -> Found:
    """Return all arrays of an HDF5 file; errors as in ``read_hdf5``."""
    import h5py

    with h5py.File(path, "r") as data:
        keys = tuple(
            str(key)
            for key in data
            if not isinstance(data.get(key, getlink=True), h5py.HardLink)
            or isinstance(data[key], h5py.Dataset)
        )
    return read_hdf5(path, name, keys)


def read_all_of_matlab(path: Path, name: str) -> Found:
    """Return all arrays of a MATLAB 5 file; errors as in ``read_matlab``."""
    from scipy.io import whosmat

    return read_matlab(path, name, tuple(key for key, *_ in whosmat(path, appendmat=False)))


def read_hdf5(path: Path, name: str, keys: tuple[str, ...] = RF) -> Found:
    """Return arrays of an HDF5 file; sizes are compared before anything is read.

    Raises:
        InvalidInputError: an array in another file, too large, or not of numbers.
    """
    import h5py

    with path.open("rb") as file:
        matlab = file.read(len(MATLAB_73_MAGIC)) == MATLAB_73_MAGIC
    found: Found = {}
    with h5py.File(path, "r") as data:
        matlab = matlab or any(
            "MATLAB_class" in data[key].attrs
            for key in keys
            if isinstance(data.get(key, getlink=True), h5py.HardLink)
        )
        found |= dict.fromkeys(str(key) for key in data)
        for key in keys:
            item: Any
            if key in data:
                item = _own(data, key, name)
            elif key in data.attrs:
                item = data.attrs.get_id(key)  # not yet its value
            else:
                continue
            require_size(tuple(item.shape or ()), MAX_VALUES, f"{name}: {key}")
            if item.dtype.kind not in REAL:  # texts, records: whatever is in them is not read
                found[key] = np.zeros(0, dtype=item.dtype if item.dtype.kind == "c" else "S1")
                continue
            value = np.asarray(item[()] if isinstance(item, h5py.Dataset) else data.attrs[key])
            found[key] = value.T if matlab else value  # MATLAB writes columns first
    return found


def _own(data: Any, key: str, name: str) -> Any:
    """Return what is in the file itself: nothing that it points to elsewhere is opened."""
    import h5py

    link = data.get(key, getlink=True)
    item = data[key] if isinstance(link, h5py.HardLink) else None
    if isinstance(item, h5py.Group):
        raise InvalidInputError(f"{name}: {key} is a group, expected numbers")
    if not isinstance(item, h5py.Dataset) or item.external or item.is_virtual:
        raise InvalidInputError(f"{name}: {key} {REFUSED_HDF5}")
    if item.chunks is not None:  # one is unpacked as a whole, however little of it is wanted
        require_size(item.chunks, MAX_VALUES, f"{name}: a chunk of {key}")
    return item


def read_matlab(path: Path, name: str, keys: tuple[str, ...] = RF) -> Found:
    """Return arrays of a MATLAB 5 file, those that are no numbers without their contents.

    Raises:
        InvalidInputError: an array that is too large.
    """
    from scipy.io import loadmat, whosmat

    shapes = {key: tuple(shape) for key, shape, _ in whosmat(path, appendmat=False)}
    for key in keys:
        require_size(shapes.get(key, ()), MAX_VALUES, f"{name}: {key}")
    data: dict[str, Any] = loadmat(path, appendmat=False, variable_names=list(keys))
    found: Found = dict.fromkeys(shapes)
    for key in keys:
        if key in data:
            value = np.asarray(data[key])
            plain = value.dtype.kind in f"{REAL}c"
            found[key] = value if plain else np.zeros(0, dtype="S1")
    return found


def _from_npz(file: NamedFile, all_of_them: bool) -> Found:
    found: Found = {}
    with open_zip(file.data, f"{file.name} is a damaged npz file") as archive:
        infos = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        found |= dict.fromkeys(infos)
        for key in infos if all_of_them else RF:
            if key in infos:
                with archive.open(infos[key]) as member:
                    _check_header(member.read(MAX_HEADER_BYTES + 16), f"{file.name}: {key}")
                most = 8 * MAX_VALUES + MAX_HEADER_BYTES + 16
                found[key] = array_from_npy(read_member(archive, infos[key], most))
    return found


def _check_header(start: bytes, what: str) -> None:
    """Refuse an array for its size or its type by what its file begins with."""
    shape, _, dtype, _ = array_header(start)
    require_size(shape, MAX_VALUES, what)
    if dtype.itemsize > 8 and not dtype.hasobject:
        words = str(dtype)[:60]
        raise InvalidInputError(f"{what} must be real numbers, not values of type {words}")


MOST_PARTS = 20_000  # datasets and attributes
MOST_DEPTH = 12
MOST_LETTERS = 1000  # of a text


def read_hdf5_tree(file: NamedFile) -> Found:
    """Return all arrays of numbers by their path, and numbers and texts of attributes, `path@name`.

    It reads in a process of its own, follows no links, and is bounded.

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
