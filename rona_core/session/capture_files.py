"""Captures as HDF5, for other programs and back: a group for each, fields by their names.

Arrays are datasets, single numbers and words are attributes of their group, what is missing is left
out, and several captures of a kind are numbered from 0. A pose is a matrix (4, 4), several are
(n, 4, 4). Unit and frames stand as attributes beside each array, as its name says them.
"""

import dataclasses
import io
import re
import types
import typing
from collections.abc import Mapping
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

from rona_core.errors import InvalidInputError, SessionFormatError
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.codec import MAY_BE_MISSING, TYPE_KEY, decode, field_hints

FORMAT, VERSION = "RONA captures", 1
COMPUTED = "computed"  # group of what is not recorded
KIND, ITEMS = "kind", "items"  # attributes: class of a group, and how many captures it holds
UNITS = {  # by the end of a name, the longest first
    "per_mm": "1/mm",
    "mm_per_us": "mm/us",
    "n_per_mm": "N/mm",
    "mm": "mm",
    "um": "um",
    "us": "us",
    "mhz": "MHz",
    "rad": "rad",
    "deg": "deg",
    "nmm": "N mm",
    "kg": "kg",
    "s": "s",
    "n": "N",
    "c": "degC",
}
OF_FIELDS = {"rf": "share of the full scale", "wrench": "N, N mm", "offset": "N, N mm"}
FRAMED = re.compile(r"Ts?_([a-z]+)_([a-z0-9]+)$")
IN_FRAME = re.compile(
    r"(?:places|axes|points|geometry|com|tip|seat)_(?:[a-z]+_)*?([a-z]+)(?:_mm)?$"
)
SHARED = 4096  # arrays of more values are packed

Arrays = Mapping[str, NDArray[Any] | None]


def captures_hdf5(
    captures: Mapping[str, Any],
    about: Mapping[str, str | int],
    Ts_base_probe: Mapping[str, Poses] | None = None,
) -> bytes:
    """Return captures as an HDF5 file; those that are None or () are left out.

    Args:
        captures: By their names in the session; a capture, or a tuple of several.
        about: Attributes of the whole file.
        Ts_base_probe: Poses of the probe at each A-scan, by pass; they are computed, and not read.
    """
    import h5py  # slow to import

    memory = io.BytesIO()
    with h5py.File(memory, "w") as file:
        file.attrs.update({"format": FORMAT, "version": VERSION, **about})
        for name, held in captures.items():
            if held is not None and held != ():
                _write(file, name, held)
        for name, poses in (Ts_base_probe or {}).items():
            _write(file.require_group(f"{COMPUTED}/{name}"), "Ts_base_probe", poses)
    return memory.getvalue()


def _write(group: Any, name: str, value: Any) -> None:
    """Write a value under a name of a group."""
    if value is None:
        return
    if isinstance(value, Pose | Poses):
        value = _matrices(value)
    if isinstance(value, np.ndarray):
        packed: dict[str, Any] = {}
        if value.size > SHARED:
            packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
        made = group.create_dataset(name, data=value, **packed)
        made.attrs.update(_described(name))
    elif dataclasses.is_dataclass(value):
        part = group.create_group(name)
        part.attrs[KIND] = type(value).__name__
        for one in dataclasses.fields(value):
            _write(part, one.name, getattr(value, one.name))
    elif isinstance(value, tuple) and not all(isinstance(x, str | int | float) for x in value):
        part = group.create_group(name)
        part.attrs[ITEMS] = len(value)
        for number, one in enumerate(value):
            _write(part, str(number), one)
    else:
        group.attrs[name] = list(value) if isinstance(value, tuple) else value


def _matrices(value: Pose | Poses) -> NDArray[np.float64]:
    if isinstance(value, Pose):
        return value.matrix()
    made = np.tile(np.eye(4), (len(value), 1, 1))
    made[:, :3, :3], made[:, :3, 3] = value.rotations, value.translations
    return made


def _described(name: str) -> dict[str, str]:
    """Return unit and frames of an array, as far as its name says them."""
    if framed := FRAMED.match(name):
        return {"unit": "mm", "parent": framed[1], "child": framed[2]}
    words = name.split("_")
    ends = ["_".join(words[k:]) for k in range(1, len(words))]
    unit = OF_FIELDS.get(name) or next((UNITS[end] for end in ends if end in UNITS), "")
    placed = IN_FRAME.match(name)
    if placed and not unit and not name.startswith("axes"):
        unit = "mm"
    found = {"unit": unit, "frame": placed[1] if placed else ""}
    return {key: value for key, value in found.items() if value}


def capture_from(name: str, kinds: tuple[type, ...], arrays: Arrays, where: str) -> Any:
    """Return what stands under a name, a capture or a tuple of several; None without any.

    Args:
        name: Of the capture in the session.
        kinds: The classes that it may be of; the first one where the file does not say.
        arrays: What the file holds: datasets by their path, attributes as ``path@name``. Number and
            set-up of a capture may be missing: an import gives it others.
        where: The file, for messages.

    Raises:
        InvalidInputError: something is missing, or of another shape or type; it says which.
    """
    if not _below(name, arrays):
        return None
    read = _Reader(arrays)
    try:
        if (count := arrays.get(f"{name}@{ITEMS}")) is not None:
            return tuple(read.capture(f"{name}/{k}", kinds) for k in range(int(count)))
        return read.capture(name, kinds)
    except SessionFormatError as error:
        raise InvalidInputError(f"{where}: {error}") from error


def _below(path: str, arrays: Arrays) -> bool:
    return any(key.startswith((f"{path}/", f"{path}@")) for key in arrays)


class _Reader:
    """Plain data of a session, as ``codec.decode`` takes them, from arrays and attributes."""

    def __init__(self, arrays: Arrays) -> None:
        self._arrays = arrays
        self._given: dict[str, NDArray[Any]] = {}  # arrays in the types of their fields

    def capture(self, path: str, kinds: tuple[type, ...]) -> Any:
        named = self._attribute(path, KIND)
        kind = next((one for one in kinds if one.__name__ == named), kinds[0])
        data = {"ordinal": 0, "setup_digest": "", **self._data(kind, path)}
        return decode(data, kind, self._given, path)

    def _attribute(self, path: str, name: str) -> Any:
        value = self._arrays.get(f"{path}@{name}")
        return None if value is None else value.item() if value.ndim == 0 else value.tolist()

    def _data(self, hint: Any, path: str) -> Any:
        """Return what stands at a path, as data of a type."""
        origin, arguments = typing.get_origin(hint), typing.get_args(hint)
        if origin in (Union, types.UnionType):
            held = [one for one in arguments if one is not type(None)]
            if not self._holds(path):
                return None
            named = self._attribute(path, KIND)
            return self._data(next((o for o in held if _name(o) == named), held[0]), path)
        if hint in (Pose, Poses):
            return self._poses(hint, path)
        if origin is np.ndarray or hint is np.ndarray:
            return self._array(hint, path)
        if origin is tuple and dataclasses.is_dataclass(arguments[0]):
            count = self._attribute(path, ITEMS)
            return [self._data(arguments[0], f"{path}/{k}") for k in range(int(count or 0))]
        if dataclasses.is_dataclass(hint):
            return self._fields(hint, path)
        group, _, name = path.rpartition("/")
        return self._attribute(group, name)

    def _fields(self, kind: Any, path: str) -> dict[str, Any]:
        data: dict[str, Any] = {TYPE_KEY: kind.__name__}
        hints = field_hints(kind)
        for one in dataclasses.fields(kind):
            place = f"{path}/{one.name}"
            if self._holds(place):
                data[one.name] = self._data(hints[one.name], place)
            elif type(None) in typing.get_args(hints[one.name]):
                data[one.name] = None
            elif (
                one.default is not dataclasses.MISSING and not one.metadata.keys() & MAY_BE_MISSING
            ):
                data[one.name] = one.default
            elif typing.get_origin(hints[one.name]) is tuple:
                data[one.name] = []
        return data

    def _holds(self, path: str) -> bool:
        group, _, name = path.rpartition("/")
        known = path in self._arrays or f"{group}@{name}" in self._arrays
        return known or _below(path, self._arrays)

    def _array(self, hint: Any, path: str) -> Any:
        found = self._arrays.get(path)
        if found is None:
            return None
        kinds = [typing.get_args(part)[0] for part in typing.get_args(hint)[1:]] or [None]
        if kinds[0] is not None and found.dtype.kind == np.dtype(kinds[0]).kind:
            found = found.astype(kinds[0])
        if found.dtype.kind == "f" and not np.isfinite(found).all():
            row = int(np.argmax(~np.isfinite(found.reshape(len(found), -1)).all(axis=1)))
            raise SessionFormatError(f"{path} is not finite in row {row}")
        self._given[path] = found
        return {"array": path}

    def _poses(self, kind: type, path: str) -> Pose | Poses:
        found = self._arrays.get(path)
        if found is None or found.dtype.kind != "f" or found.shape[-2:] != (4, 4):
            shape = None if found is None else found.shape
            raise SessionFormatError(f"{path}: expected matrices (4, 4), found {shape}")
        try:
            if kind is Pose:
                return Pose(found[:3, :3], found[:3, 3])
            return Poses(found[:, :3, :3], found[:, :3, 3])
        except (ValueError, IndexError) as error:
            raise SessionFormatError(f"{path}: {error}") from error


def _name(hint: Any) -> str:
    return getattr(typing.get_origin(hint) or hint, "__name__", "")
