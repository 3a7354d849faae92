"""Reader of NRRD and NIfTI voxels in slabs, so that no volume lies in memory whole.

The voxels are read from the file itself: a header that points to another file is refused.
"""

import bz2
import gzip
import io
import re
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import nibabel
import nrrd
import numpy as np
from numpy.typing import NDArray

from rona_core.devices.files.size_limits import open_file
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats

MOST_VOXELS = 160_000_000
SLAB_BYTES = 16 * 1024**2
MAX_HEADER_BYTES = 1024**2
UNREAD = "could not be read as "
GZIP_MAGIC = b"\x1f\x8b"
KINDS = "fiu"  # values that can be compared: float, int, unsigned

# which way y grows: +1 to the back, -1 to the front, 0 not said
BACK = {
    "left-posterior-superior": 1,
    "lps": 1,
    "right-anterior-superior": -1,
    "ras": -1,
    "left-anterior-superior": -1,
    "las": -1,
}
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
HEADERS = {348: nibabel.Nifti1Header, 540: nibabel.Nifti2Header}
SINGLE_FILE = (b"n+1", b"n+2")  # a pair of header and image says ni1 or ni2


@dataclass(frozen=True, slots=True, eq=False)
class Voxels:
    """Shape and place of a volume, and its layers along the third axis, once."""

    shape: tuple[int, int, int]
    T_skull_voxel: Floats  # (4, 4): coordinates of an index, in mm
    back: int  # +1 if y grows to the back of the head, -1 to the front, 0 unknown
    slabs: Iterator[NDArray[Any]]  # (nx, ny, some) each, from the first layer to the last


@contextmanager
def open_voxels(path: Path) -> Generator[Voxels]:
    """Open a volume; errors in its data come while its layers are read.

    Args:
        path: A .nrrd, .nii or .nii.gz file.

    Raises:
        InvalidInputError: no plain file, damaged, foreign, too large, or with data elsewhere.
    """
    kind = _kind(path.name)
    begin = _begin_nrrd if kind == "NRRD" else _begin_nifti
    try:
        with open_file(path, f"a {kind} file") as file:
            yield begin(file, path.name)
    except InvalidInputError:
        raise
    except Exception as error:  # the libraries throw whatever they like at damaged files
        words = re.sub(r"\s+", " ", str(error))[:160] or type(error).__name__
        raise InvalidInputError(f"{path.name} {UNREAD}{kind} ({words}): export it again") from error


# ------------------------------------------------------------------ NRRD


def _begin_nrrd(file: BinaryIO, name: str) -> Voxels:
    start = file.read(MAX_HEADER_BYTES)
    end = re.search(rb"\r?\n[ \t]*\r?\n", start)
    if end is None:
        if re.search(rb"^data ?file[ \t]*:", start, re.MULTILINE | re.IGNORECASE):
            raise InvalidInputError(_elsewhere(name))
        raise InvalidInputError(f"{name} {UNREAD}NRRD: its header has no end")
    header: Any = nrrd.read_header(io.BytesIO(start[: end.end()]))
    keys = {str(key).lower().replace(" ", ""): key for key in header}
    if "datafile" in keys:
        raise InvalidInputError(_elsewhere(name))
    shape = _checked_shape(name, tuple(int(n) for n in header["sizes"]))
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
    if axes is None:
        raise InvalidInputError(
            f"{name} {UNREAD}NRRD: it does not say how large its voxels are; export again"
        )
    affine = np.eye(4)
    affine[:3, :3] = np.asarray(axes, dtype=np.float64).T
    affine[:3, 3] = header.get("space origin", np.zeros(3))
    return Voxels(shape, affine, BACK.get(str(header.get("space", "")).lower(), 0), slabs)


def _elsewhere(name: str) -> str:
    return (
        f"{name} says that its voxels lie in another file, which is not opened: expected header "
        f"and voxels in one .nrrd file; export it again with the data attached"
    )


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
    return _layers(readers[encoding]().read, shape, dtype, name, to_the_end=True)


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
            raise InvalidInputError(_too_short(name))
    if len(held) or rest.strip() or file.read(1 << 16).strip():
        raise InvalidInputError(_too_long(name))


# ------------------------------------------------------------------ NIfTI


def _begin_nifti(file: BinaryIO, name: str) -> Voxels:
    zipped = file.read(2) == GZIP_MAGIC
    file.seek(0)
    stream: Any = gzip.GzipFile(fileobj=file) if zipped else file
    start = stream.read(4)
    size = next(
        (n for order in ("little", "big") if (n := int.from_bytes(start, order)) in HEADERS), 0
    )
    if not size:
        raise InvalidInputError(
            f"{name} {UNREAD}NIfTI (its header has another size): export it again"
        )
    header: Any = HEADERS[size](start + stream.read(size - 4))
    if bytes(header["magic"])[:3] not in SINGLE_FILE:
        raise InvalidInputError(
            f"{name} says that its voxels lie in another file, which is not opened: expected "
            f"header and voxels in one .nii or .nii.gz file; export it again"
        )
    shape = tuple(int(n) for n in header.get_data_shape())
    while len(shape) > 3 and shape[-1] == 1:
        shape = shape[:-1]
    checked = _checked_shape(name, shape)
    unit = header.get_xyzt_units()[0]
    if unit in ("meter", "micron"):
        raise InvalidInputError(f"{name} is in units of {unit}: expected millimetres")
    dtype = header.get_data_dtype()
    if dtype.kind not in KINDS:
        raise InvalidInputError(f"{name} holds values of type {dtype}: expected numbers")
    skip = int(header.get_data_offset()) - size
    if skip < 0:
        raise InvalidInputError(f"{name} {UNREAD}NIfTI: its voxels begin too early")
    while skip and (part := stream.read(min(skip, 1 << 20))):  # extensions of the header
        skip -= len(part)
    slope, start_value = header.get_slope_inter()
    layers = _layers(stream.read, checked, dtype, name, to_the_end=False)
    if slope is not None and (slope, start_value) != (1.0, 0.0):
        layers = (layer.astype(np.float64) * slope + start_value for layer in layers)
    return Voxels(checked, np.array(header.get_best_affine(), dtype=np.float64), -1, layers)


# ------------------------------------------------------------------ both


def _checked_shape(name: str, shape: tuple[int, ...]) -> tuple[int, int, int]:
    if len(shape) != 3 or min(shape) < 8:
        raise InvalidInputError(
            f"{name} must be one volume of at least 8 voxels a side, not {shape}: export one "
            f"scalar volume"
        )
    if shape[0] * shape[1] * shape[2] > MOST_VOXELS:
        raise InvalidInputError(
            f"{name} has {shape} voxels: at most {MOST_VOXELS / 1e6:.0f} million; crop or resample"
        )
    return shape[0], shape[1], shape[2]


def _layers(
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
            raise InvalidInputError(_too_short(name))
        yield np.frombuffer(data, dtype).reshape(*shape[:2], count, order="F")
    if to_the_end and read(1):
        raise InvalidInputError(_too_long(name))


def _too_short(name: str) -> str:
    return (
        f"{name} {UNREAD}{_kind(name)}: it has fewer voxels than its header says; export it again"
    )


def _too_long(name: str) -> str:
    return f"{name} {UNREAD}{_kind(name)}: it has more voxels than it says; export it again"


def _kind(name: str) -> str:
    return "NRRD" if name.lower().endswith(".nrrd") else "NIfTI"
