"""Arrays of poses in .npy, .npz, .mat, HDF5 and .json files, as tables with names where they have.

Shapes (n, 4, 4), (n, 3, 4) and, as MATLAB keeps them, (4, 4, n) are matrices; (n, 3, 3) with a
(n, 3) of the same name but R and t are rotations and translations, as OpenCV wants them; (n, k) is
a table of k columns.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from rona_core.devices.files.arrays import MAGICS, read_arrays
from rona_core.devices.files.npy import MAGIC, array_from_npy
from rona_core.devices.files.poses.pose_columns import CELLS, NAME, ROTATION, TIMES
from rona_core.devices.files.text_tables import NamedFile, Table
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats

MAX_DEPTH = 6
TURNS, SHIFTS = {"r", "rot", "rotation"}, {"t", "trans", "translation", "tvec"}


def is_of_arrays(file: NamedFile) -> bool:
    """Return whether a file is one of these, by its first bytes."""
    start = file.data[:520]
    return start.lstrip()[:1] in (b"{", b"[") or any(m in start for m in (*MAGICS, MAGIC))


def read_tables(file: NamedFile) -> dict[str, Table]:
    """Return the tables of a file of arrays, each under its name.

    Raises:
        InvalidInputError: damaged, or no poses in it.
    """
    start = file.data.lstrip()[:1]
    if start in (b"{", b"["):
        value: Any = _json(file)
    elif file.data.startswith(MAGIC):
        try:
            value = array_from_npy(file.data)
        except ValueError as error:
            raise InvalidInputError(f"{file.name} is a damaged .npy file: {error}") from error
    else:
        value = read_arrays(file, all_of_them=True)
    found = _tables(value, file.name, NAME, MAX_DEPTH)
    if not found:
        named = value if isinstance(value, Mapping) else {}
        shapes = ", ".join(f"{k} {np.shape(v)}" for k, v in named.items())
        raise InvalidInputError(
            f"{file.name} holds no poses: expected arrays of shape (n, 4, 4), (n, 3, 4), or (n, 7) "
            "(x, y, z and a quaternion), R (n, 3, 3) and t (n, 3), or in JSON objects with "
            f"position and quaternion{'; it has ' + shapes[:200] if shapes else ''}"
        )
    return found


def _json(file: NamedFile) -> Any:
    try:
        return json.loads(file.data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InvalidInputError(f"{file.name} is damaged JSON: {str(error)[:100]}") from error


def _is_map(value: Any) -> bool:
    return isinstance(value, Mapping)


def _tables(value: Any, name: str, key: str, depth: int) -> dict[str, Table]:
    """Return the tables in a value, whether an array, a list of objects or an object of these."""
    if depth and _is_map(value):
        flat = _flat(value)
        if any(isinstance(v, float | int) and not isinstance(v, bool) for v in flat.values()) and (
            not any(np.ndim(v) > 1 for v in value.values() if not _is_map(v))
        ):
            return _records([flat], name, key)  # one pose
        return _of_arrays(value, name) | {
            k: table
            for own, inner in value.items()
            if _is_map(inner) or _is_records(inner)
            for k, table in _tables(inner, name, str(own), depth - 1).items()
        }
    if _is_records(value):
        return _records([_flat(record) for record in value], name, key)
    return _of_arrays({key: value}, name)


def _is_records(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(map(_is_map, value))


def _flat(record: Mapping[str, Any], depth: int = MAX_DEPTH) -> dict[str, Any]:
    """Return the values of an object with names joined by points; lists count from 0."""
    found: dict[str, Any] = {}
    for key, value in record.items():
        listed = isinstance(value, list) and len(value) <= 16
        inner: Any = {str(k): v for k, v in enumerate(value)} if listed else value
        if _is_map(inner) and depth:
            of = "quaternion" if key == "q" and len(inner) == 4 else key
            found |= {f"{of}.{k}": v for k, v in _flat(inner, depth - 1).items()}
        else:
            found[str(key)] = value
    return found


def _records(records: list[dict[str, Any]], name: str, key: str) -> dict[str, Table]:
    header = list(dict.fromkeys(k for record in records for k in record))
    rows = tuple(tuple(_cell(record.get(k)) for k in header) for record in records)
    return {key: Table(name, tuple(k.lower() for k in header), rows)}


def _cell(value: Any) -> str:
    if value is None or isinstance(value, (list, dict)):
        return ""
    return value if isinstance(value, str) else str(int(value) if value is True else value)


def _of_arrays(found: Mapping[str, Any], name: str) -> dict[str, Table]:
    """Return a table for each array, or pair of arrays, that may be poses."""
    arrays = {key: array for key, v in found.items() if (array := _numbers(v)) is not None}
    times = next((a.ravel() for k, a in arrays.items() if k.lower() in TIMES and a.size > 1), None)
    tables: dict[str, Table] = {}
    for key, array in arrays.items():
        place = _partner(key, arrays)
        if array.ndim == 3 and array.shape[1:] == (3, 3) and place is not None:
            header, values = [*ROTATION, "x", "y", "z"], np.hstack((array.reshape(-1, 9), place))
            key = " ".join(_of_pair(key, TURNS) or ()) or NAME
        elif array.ndim == 3 and (matrices := _matrices(array, f"{name}: {key}")) is not None:
            values = matrices.reshape(len(matrices), -1)
            header = list(CELLS[: values.shape[1]])
        elif array.ndim == 2 and array.shape[1] in (3, 4) and array.shape[0] == array.shape[1]:
            header, values = list(CELLS), array.reshape(1, -1)
        elif array.ndim == 2 and array.shape[1] >= 6:
            header, values = None, array
        else:
            continue
        if header is not None and times is not None and len(times) == len(values):
            header, values = ["time", *header], np.column_stack((times, values))
        rows = tuple(tuple(map(repr, row)) for row in values.tolist())
        tables[key] = Table(name, None if header is None else tuple(header), rows)
    return tables


def _numbers(value: Any) -> Floats | None:
    """Return an array of numbers; None for anything else."""
    try:
        array = np.asarray(value)
    except ValueError:  # lists of different lengths
        return None
    return array.astype(np.float64) if array.dtype.kind in "iuf" and array.size else None


def _of_pair(key: str, of: set[str]) -> list[str] | None:
    """Return the words of a name beside the one that says rotation or translation."""
    words = re.findall(r"[a-z]+|\d+", key.lower())
    own = [word for word in words if word.rstrip("s") in of]
    return [word for word in words if word != own[0]] if own else None


def _partner(key: str, arrays: Mapping[str, Floats]) -> Floats | None:
    """Return the translations (n, 3) that belong to the rotations under a name."""
    mine = _of_pair(key, TURNS)
    for other, array in arrays.items():
        flat = array.reshape(len(array), -1)
        if mine is not None and mine == _of_pair(other, SHIFTS) and flat.shape[1] == 3:
            return flat if len(flat) == len(arrays[key]) else None
    return None


def _matrices(array: Floats, what: str) -> Floats | None:
    """Return matrices (n, 3 or 4, 4), whichever axis counts them; None for other shapes.

    Raises:
        InvalidInputError: both axes may count them.
    """
    ways = [array] if array.shape[1:] in ((4, 4), (3, 4)) else []
    if array.shape[:2] in ((4, 4), (3, 4)):
        ways.append(np.moveaxis(array, 2, 0))
    if len(ways) == 2:
        ways = [w for w in ways if np.allclose(w[:, 3:], (0, 0, 0, 1)) and w.shape[1] == 4]
        if len(ways) != 1:
            raise InvalidInputError(
                f"{what} has shape {array.shape}: does the first or the last axis count the poses? "
                "Save one pose more, or less"
            )
    return ways[0] if ways else None
