"""Reader of points: PLY, CSV, and markups of 3D Slicer (``.mrk.json``); all in mm."""

import json
import re
from typing import Any

import numpy as np

from rona_core.devices.files.size_limits import MAX_FILE_BYTES
from rona_core.devices.files.text_tables import NamedFile, read_table
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly

MOST_POINTS = 2_000_000
PLY_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
PLY_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
AXES = re.compile(r"(?:points?_?)?([xyz])(?:_base)?(?:_(mm|m|cm|um))?")
TO_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3}
LEAST_MM = 2.0  # what spreads by less is hardly in mm


def read_points(file: NamedFile) -> Floats:
    """Return the points (n, 3) of a file, in mm and in their order.

    Columns of a CSV are x, y, z (with a unit, ``x_mm``, or in mm), or its first three without a
    header. Markups in right-anterior-superior are turned into left-posterior-superior, which RONA
    takes for the axes of its frame.

    Raises:
        InvalidInputError: another kind of file, damaged, no points, or hardly in mm; it says where.
    """
    name = file.name.lower()
    if name.endswith(".ply"):
        points = _ply(file)
    elif name.endswith(".json"):
        points = _markups(file)
    elif name.endswith((".csv", ".txt", ".xyz", ".tsv")):
        points = _csv(file)
    else:
        raise InvalidInputError(f"{file.name} is no file of points: .ply, .csv, .xyz, .mrk.json")
    if len(points) > MOST_POINTS:
        raise InvalidInputError(f"{file.name} has {len(points)} points, {MOST_POINTS} are the most")
    finite = np.isfinite(points).all(axis=1)
    if len(points) < 2 or not finite.all():
        bad = f"point {int(np.argmin(finite))} is not finite" if len(points) else "no points"
        raise InvalidInputError(f"{file.name}: expected two points or more, all finite: {bad}")
    spread_mm = float(np.ptp(points, axis=0).max())
    if spread_mm < LEAST_MM:
        raise InvalidInputError(
            f"{file.name}: the points spread by {spread_mm:.3g} mm: they seem to be in metres; "
            "write them in mm, or name the columns x_m, y_m, z_m"
        )
    return readonly(points)


def _csv(file: NamedFile) -> Floats:
    table = read_table(file)
    if table.header is None:
        return table.numbers(len(table.rows[0]))[:, :3] if table.rows[0][2:] else np.zeros((0, 3))
    named = {m[1]: (k, m[2]) for k, h in enumerate(table.header) if (m := AXES.fullmatch(h))}
    if set(named) != set("xyz"):
        raise InvalidInputError(
            f"{file.name}: expected columns x, y and z in mm (or x_mm, x_m), got "
            f"{', '.join(table.header)}"
        )
    numbers = np.zeros((len(table.rows), 3))
    for axis, letter in enumerate("xyz"):
        column, unit = named[letter]
        for row, cells in enumerate(table.rows):
            try:
                numbers[row, axis] = float(cells[column]) * TO_MM[unit or "mm"]
            except (ValueError, IndexError):
                raise InvalidInputError(f"{table.where(row)}: {letter} is no number") from None
    return numbers


def _markups(file: NamedFile) -> Floats:
    try:
        content = json.loads(file.data)
        (markup,) = content["markups"]
        points = np.array([one["position"] for one in markup["controlPoints"]], dtype=np.float64)
        system, unit = markup.get("coordinateSystem", "LPS"), markup.get("coordinateUnits", "mm")
        points = points.reshape(-1, 3) * TO_MM[unit]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InvalidInputError(
            f"{file.name}: expected markups of 3D Slicer with one list of control points ({error})"
        ) from None
    if str(system).upper() in ("RAS", "0"):
        points = points * (-1.0, -1.0, 1.0)
    return points


def _ply(file: NamedFile) -> Floats:
    """Return the vertices of a PLY; faces are left out."""
    end = file.data.find(b"end_header")
    body = file.data.find(b"\n", end) + 1
    if not file.data.startswith(b"ply") or end < 0 or not body:
        raise InvalidInputError(f"{file.name} is no PLY: it has no whole header")
    order, count, columns = _ply_header(file.data[:end].decode("ascii", "replace"), file.name)
    if count * len(columns) > MAX_FILE_BYTES:
        raise InvalidInputError(f"{file.name} claims {count} vertices: it is damaged")
    try:
        if order is None:
            words = file.data[body:].split(maxsplit=count * len(columns))[: count * len(columns)]
            rows: Any = np.array(words, dtype=np.float64).reshape(count, len(columns))
            return rows[:, [list(columns).index(axis) for axis in "xyz"]]
        kinds = np.dtype([(name, order + kind) for name, kind in columns.items()])
        rows = np.frombuffer(file.data, kinds, count, body)
        return np.column_stack([rows[axis].astype(np.float64) for axis in "xyz"])
    except (ValueError, KeyError) as error:
        raise InvalidInputError(f"{file.name} is a damaged PLY: {error}") from None


def _ply_header(text: str, name: str) -> tuple[str | None, int, dict[str, str]]:
    """Return byte order (None: ASCII), number of vertices, and the types of their properties."""
    order, count, columns, here = None, 0, dict[str, str](), False
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = PLY_ORDERS.get(words[1])
        elif words[:1] == ["element"]:
            if columns:
                break  # vertices come first
            here = words[1] == "vertex"
            if not here:
                raise InvalidInputError(f"{name}: expected the vertices to come first")
            count = int(words[2]) if words[2].isdigit() else 0
        elif words[:1] == ["property"] and here:
            if words[1] not in PLY_TYPES:
                raise InvalidInputError(f"{name}: vertices have a property of type {words[1]}")
            columns[words[-1]] = PLY_TYPES[words[1]]
    if not {"x", "y", "z"} <= set(columns):
        raise InvalidInputError(f"{name}: the vertices have no x, y and z")
    return order, count, columns
