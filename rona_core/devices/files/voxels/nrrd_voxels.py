"""Voxels of an NRRD file, header and data in one."""

import bz2
import gzip
import io
import re
from collections.abc import Callable, Generator, Iterator
from typing import Any, BinaryIO

import nrrd
import numpy as np
from numpy.typing import NDArray

from rona_core.devices.files.voxels.refusals import refused
from rona_core.devices.files.voxels.voxel_layers import (
    UNREAD,
    Voxels,
    checked_shape,
    layers_of,
    too_long,
    too_short,
)
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats

MAX_HEADER_BYTES = 1024**2
# spaces without names of the head, and whether they are right-handed
PLAIN_SPACES = {
    "scanner-xyz": True,
    "3d-right-handed": True,
    "3d-left-handed": False,
}
# what an axis of a space grows to, in left, posterior, superior
WAYS = {
    "left": (1, 0, 0),
    "right": (-1, 0, 0),
    "posterior": (0, 1, 0),
    "anterior": (0, -1, 0),
    "superior": (0, 0, 1),
    "inferior": (0, 0, -1),
}
MILLIMETRES = ("mm", "millimeter", "millimetre", "millimeters", "millimetres")
UNITS_MM = {"m": 1e3, "cm": 10.0, "um": 1e-3, "\u00b5m": 1e-3, "\u03bcm": 1e-3, "micrometer": 1e-3}
# the words that NRRD has for types of numbers
NRRD_WORDS = {
    "i1": "signed char,int8,int8_t",
    "u1": "uchar,unsigned char,uint8,uint8_t",
    "i2": "short,short int,signed short,signed short int,int16,int16_t",
    "u2": "ushort,unsigned short,unsigned short int,uint16,uint16_t",
    "i4": "int,signed int,int32,int32_t",
    "u4": "uint,unsigned int,uint32,uint32_t",
    "i8": "longlong,long long,long long int,signed long long,signed long long int,int64,int64_t",
    "u8": "ulonglong,unsigned long long,unsigned long long int,uint64,uint64_t",
    "f4": "float",
    "f8": "double",
}
NRRD_TYPES = {word: code for code, words in NRRD_WORDS.items() for word in words.split(",")}
TEXT = ("ascii", "text", "txt")  # encodings
ENDIANS = {"big": ">", "little": "<"}


def begin_nrrd(file: BinaryIO, name: str) -> Voxels:
    """Return the voxels of a file, of which the header is read."""
    start = file.read(MAX_HEADER_BYTES)
    end = re.search(rb"\r?\n[ \t]*\r?\n", start)
    if end is None:
        if re.search(rb"^data ?file[ \t]*:", start, re.MULTILINE | re.IGNORECASE):
            raise refused("voxels in another file", name=name)
        raise InvalidInputError(f"{name} {UNREAD}NRRD: its header has no end")
    header: Any = nrrd.read_header(io.BytesIO(start[: end.end()]))
    keys = {str(key).lower().replace(" ", ""): key for key in header}
    if "datafile" in keys:
        raise refused("voxels in another file", name=name)
    shape = checked_shape(name, tuple(int(n) for n in header["sizes"]))
    _check_units(header, name)
    space = str(header.get("space", ""))
    to_right_handed, back = _hand(space, name)
    if int(header["dimension"]) != len(shape):
        raise InvalidInputError(f"{name}: its dimension is not that of its sizes: export it again")
    encoding = str(header["encoding"]).lower()
    dtype = _nrrd_dtype(str(header["type"]), str(header.get("endian", "")), encoding, name)
    file.seek(end.end())
    skips = {key: int(header[keys[key]]) for key in ("lineskip", "byteskip") if key in keys}
    if skips.get("byteskip") == -1 and encoding == "raw":  # the data are what the file ends with
        file.seek(-int(np.prod(shape)) * dtype.itemsize, io.SEEK_END)
    elif any(skips.values()):
        raise InvalidInputError(
            f"{name} skips lines or bytes behind its header, which is not read: export it again"
        )
    slabs = _nrrd_slabs(file, encoding, shape, dtype, name)
    axes = header.get("space directions")
    if axes is None:
        spacings = header.get("spacings")
        axes = None if spacings is None else np.diag(spacings)
    origin = np.asarray(header.get("space origin", np.zeros(3)), dtype=np.float64)
    if axes is None or np.shape(axes) != (3, 3) or origin.shape != (3,):
        raise refused("no directions", name=name)
    affine = np.eye(4)
    affine[:3, :3] = to_right_handed @ np.asarray(axes, dtype=np.float64).T
    affine[:3, 3] = to_right_handed @ origin
    return Voxels(shape, affine, back, slabs)


def _hand(space: str, name: str) -> tuple[Floats, int]:
    """Return what turns the coordinates of a space (3, 3) into right-handed ones, and the back.

    Right-handed spaces stay as they are. Left-handed ones would show the head in a mirror: of
    those with names of the head left, posterior, superior becomes the frame, of others x is turned
    about. The back is +1 if y then grows to the back of the head, -1 to the front, 0 not said.

    Raises:
        InvalidInputError: a space that is not known, or none.
    """
    words = space.strip().lower()
    if not words:
        raise refused("no space", name=name)
    if words in PLAIN_SPACES:
        return np.diag((1.0 if PLAIN_SPACES[words] else -1.0, 1.0, 1.0)), 0
    letters = {way[0]: way for way in WAYS}
    parts = words.split("-") if "-" in words else [letters.get(c, c) for c in words]
    ways = np.array([WAYS[part] for part in parts if part in WAYS], dtype=np.float64).reshape(-1, 3)
    if len(parts) != 3 or len(ways) != 3 or np.abs(ways).sum(axis=0).tolist() != [1.0, 1.0, 1.0]:
        raise refused("an unknown space", name=name, space=space[:60])
    if np.linalg.det(ways) < 0.0:
        return ways.T, 1
    return np.eye(3), int(ways[1, 1])


def _check_units(header: Any, name: str) -> None:
    """Raise InvalidInputError if lengths are not said to be in mm; many files do not say it."""
    for key in ("space units", "units"):
        for word in header.get(key) or ():
            unit = str(word or "").strip().strip('"').lower()
            if unit and unit not in (*MILLIMETRES, "none", "???", "nan"):
                factor = UNITS_MM.get(unit, 1.0)
                raise refused("another unit", name=name, unit=repr(unit[:20]), factor=factor)


def _nrrd_dtype(word: str, endian: str, encoding: str, name: str) -> np.dtype[Any]:
    code = NRRD_TYPES.get(word.strip())
    if code is None:
        raise InvalidInputError(f"{name} holds values of type {word[:40]!r}: expected numbers")
    if code.endswith("1") or encoding in TEXT:
        return np.dtype(code)
    if endian not in ENDIANS:
        raise InvalidInputError(f"{name} does not say the order of its bytes: export it again")
    return np.dtype(ENDIANS[endian] + code)


def _nrrd_slabs(
    file: BinaryIO, encoding: str, shape: tuple[int, int, int], dtype: np.dtype[Any], name: str
) -> Iterator[NDArray[Any]]:
    if encoding in TEXT:
        return _written_layers(file, shape, name)
    readers: dict[str, Callable[[], Any]] = {
        "raw": lambda: file,
        "gzip": lambda: gzip.GzipFile(fileobj=file),
        "gz": lambda: gzip.GzipFile(fileobj=file),
        "bzip2": lambda: bz2.BZ2File(file),
        "bz2": lambda: bz2.BZ2File(file),
    }
    if encoding not in readers:
        raise InvalidInputError(
            f"{name} is packed as {encoding[:40]!r}: expected raw, gzip, bzip2 or text"
        )
    return layers_of(readers[encoding]().read, shape, dtype, name, to_the_end=True)


def _written_layers(
    file: BinaryIO, shape: tuple[int, int, int], name: str
) -> Generator[NDArray[Any]]:
    """Yield the layers of a volume whose numbers are written as text."""
    layer = shape[0] * shape[1]
    held, rest, left = np.zeros(0), b"", shape[2]
    while left:
        part = file.read(1 << 20)
        text = rest + part
        cut = len(text) if not part else max(text.rfind(b" "), text.rfind(b"\n")) + 1
        rest = text[cut:]
        held = np.concatenate((held, np.array(text[:cut].split(), dtype=np.float64)))
        whole = min(len(held) // layer, left)
        if whole:
            yield held[: whole * layer].reshape(*shape[:2], whole, order="F")
            held, left = held[whole * layer :], left - whole
        if not part and left:
            raise InvalidInputError(too_short(name))
    if len(held) or rest.strip() or file.read(1 << 16).strip():
        raise InvalidInputError(too_long(name))
