"""Positions of single markers in text files: one row for each marker that a frame saw."""

import numpy as np

from rona_core.devices.files.poses.marker_body_fit import (
    MarkerFrames,
    MarkerGeometryFile,
    checked_geometry,
)
from rona_core.devices.files.text_tables import NamedFile, Table, is_number, read_table
from rona_core.errors import InvalidInputError

COLUMNS = ("frame", "marker", "x", "y", "z")
MOST_FRAMES = 1e15  # whole numbers up to here are exact


def read_geometry_table(file: NamedFile) -> MarkerGeometryFile:
    """Read markers from rows ``marker,x,y,z`` in mm.

    Raises:
        InvalidInputError: other rows, a marker twice, two at one place, or metres.
    """
    table = read_table(file)
    order = _order(table, COLUMNS[1:])
    names, rows = [], []
    for i in range(len(table.rows)):
        cells = _cells(table, i, order, COLUMNS[1:])
        if cells[0] in names:
            raise InvalidInputError(f"{table.where(i)}: the marker {cells[0]!r} stands there twice")
        names.append(cells[0])
        rows.append(_position(table, i, cells[1:]))
    return MarkerGeometryFile(tuple(names), checked_geometry(np.array(rows), file.name))


def read_marker_frames(table: Table) -> MarkerFrames:
    """Read rows ``frame,marker,x,y,z``; a marker that was not seen has no row or empty cells.

    Raises:
        InvalidInputError: other rows, or a marker twice in a frame.
    """
    order = _order(table, COLUMNS)
    held: dict[int, dict[str, tuple[int, list[float] | None]]] = {}
    names: dict[str, None] = {}
    for i in range(len(table.rows)):
        frame_cell, marker, *xyz = _cells(table, i, order, COLUMNS)
        frame = _whole(table, i, frame_cell)
        inside = held.setdefault(frame, {})
        if marker in inside:
            raise InvalidInputError(
                f"{table.where(i)}: marker {marker!r} of frame {frame} stands in line "
                f"{table.lines[inside[marker][0]]} already"
            )
        names[marker] = None
        position = None if not any(xyz) else _position(table, i, xyz)
        inside[marker] = i, position
    known, numbers = tuple(sorted(names, key=_natural)), sorted(held)
    points = np.zeros((len(numbers), len(known), 3))
    seen = np.zeros((len(numbers), len(known)), dtype=np.bool_)
    column = {name: k for k, name in enumerate(known)}
    for n, number in enumerate(numbers):
        for marker, (_, position) in held[number].items():
            if position is not None:
                points[n, column[marker]] = position
                seen[n, column[marker]] = True
    return MarkerFrames(table.name, np.array(numbers, dtype=np.int64), known, points, seen)


def _order(table: Table, columns: tuple[str, ...]) -> list[int]:
    """Return where each column is: by the names in the header, else in the usual order."""
    if table.header is None:
        return list(range(len(columns)))
    missing = [name for name in columns if name not in table.header]
    if missing:
        raise InvalidInputError(
            f"{table.name}: expected the columns {', '.join(columns)}, "
            f"got {', '.join(table.header)}"
        )
    return [table.header.index(name) for name in columns]


def _cells(table: Table, row: int, order: list[int], columns: tuple[str, ...]) -> list[str]:
    cells = table.rows[row]
    wanted = len(columns) if table.header is None else len(table.header)
    if len(cells) != wanted:
        raise InvalidInputError(
            f"{table.where(row)}: expected {wanted} cells ({', '.join(columns)}), got {len(cells)}"
        )
    return [cells[k] for k in order]


def _position(table: Table, row: int, cells: list[str]) -> list[float]:
    for cell in cells:
        if not is_number(cell) or not np.isfinite(float(cell)):
            raise InvalidInputError(
                f"{table.where(row)}: expected finite x, y and z in mm, got {cell[:40]!r}; leave "
                "the row out where a marker was not seen"
            )
    return [float(cell) for cell in cells]


def _whole(table: Table, row: int, cell: str) -> int:
    value = float(cell) if is_number(cell) else np.nan
    if not abs(value) < MOST_FRAMES or not value.is_integer():
        raise InvalidInputError(
            f"{table.where(row)}: expected the number of a frame, got {cell[:40]!r}"
        )
    return int(value)


def _natural(name: str) -> tuple[int, int | float, str]:
    """Sort numbers as numbers, before names."""
    return (0, int(name), "") if name.isascii() and name.isdigit() else (1, 0, name)
