"""Poses in the rows of text tables: matrices, or positions with quaternions."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.devices.files.text_tables import Table, is_number
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints

MATRIX_CELL = re.compile(r"[a-z]*[\[(]?([0-4])[ ,_]?([0-4])[\])]?")
WITHOUT_TIME = {7: 7, 8: 7, 12: 12, 13: 12, 16: 16, 17: 16}  # cells of a row: of these, the pose
QUATERNION = ("qw", "qx", "qy", "qz")
POSITION = ("x", "y", "z")
MEANS = {"q0": "qw", "q1": "qx", "q2": "qy", "q3": "qz", "w": "qw"} | {
    before + axis: axis for before in ("t", "p", "pos", "position", "translation") for axis in "xyz"
}
STATES = ("state", "status")
GOOD_STATES = ("ok", "1", "true", "valid", "visible", "tracked")
FRAMES = ("frame", "framenumber", "frame#")
UNIT = 1e-2  # the length of a quaternion may differ from 1 by this
UNSEEN = 1e20  # larger numbers stand for a marker that was not seen: NDI writes -3.697314E28
EXPECTED = (
    "expected 16 numbers (a matrix, row by row), 7 (x, y, z and a quaternion qx, qy, qz, qw, or "
    "this one as qw, qx, qy, qz first), either after a time or not, columns named qw, qx, qy, qz, "
    "x, y, z, 4 numbers (a row of a 4 x 4 matrix), or frame,marker,x,y,z"
)


@dataclass(frozen=True, slots=True, eq=False)
class PoseRows:
    """Matrices (n, 4, 4) of the rows of a table that hold a pose, not checked yet."""

    matrices: Floats
    rows: Ints  # (n,) of the table
    numbers: Ints  # (n,) of their frames, growing; rows where the table does not number them


def is_pose_table(table: Table) -> bool:
    """Return whether each row of a table may be a pose."""
    return _named(table, (*QUATERNION, *POSITION)) is not None or (
        len(table.rows[0]) in WITHOUT_TIME or _named_cells(table) is not None
    )


def read_pose_rows(table: Table) -> PoseRows:
    """Read a pose from each row; rows of a marker that was not seen are left out.

    Without names, 16 or 12 numbers are a matrix row by row, and 7 are a position and a quaternion
    with the real part last, or a quaternion with the real part first and a position: which, its
    length of 1 says. One number before them is a time.

    Raises:
        InvalidInputError: cells that are no numbers, or quaternions of another length; it says
            where.
    """
    quaternion = _named(table, (*QUATERNION, *POSITION))
    cells = _named_cells(table) if quaternion is None else None
    width = len(table.header or ())
    if quaternion is not None:
        columns: Sequence[int] = quaternion
    elif cells is not None:
        columns = cells
    else:
        width = len(table.rows[0])
        size = WITHOUT_TIME[width]
        columns = range(width - size, width)
    values, rows = _values(table, columns, width)
    if len(columns) == 7:
        matrices = _from_quaternions(table, values, rows, named=quaternion is not None)
    else:
        matrices = np.zeros((len(values), 4, 4))
        matrices[:, 3, 3] = 1.0
        matrices.reshape(-1, 16)[:, : len(columns)] = values
    seen = seen_poses(matrices)
    return PoseRows(matrices[seen], rows[seen], _numbers(table, rows)[seen])


def seen_poses(matrices: Floats) -> Bools:
    """Return which matrices (n, 4, 4) are not what programs write for a marker not seen.

    That is the identity, zeros, NaN in all places, or numbers beyond all measure.
    """
    top = matrices[:, :3].reshape(-1, 12)
    unseen = _beyond(top)
    for stand_in in (np.isnan(top), top == 0.0, top == np.eye(4)[:3].ravel()):
        unseen = unseen | stand_in.all(axis=1)
    return np.asarray(~unseen, dtype=np.bool_)


def _beyond(values: Floats) -> Bools:
    """Return which rows (n,) have a finite number beyond all measure."""
    beyond = np.isfinite(values) & (np.abs(values) > UNSEEN)
    return np.asarray(beyond.any(axis=1), dtype=np.bool_)


def _names(table: Table) -> list[str]:
    plain = [re.sub(r"[\s_.\[\]()-]|mm$", "", cell) for cell in table.header or ()]
    return [MEANS.get(name, name) for name in plain]


def _named(table: Table, wanted: tuple[str, ...]) -> list[int] | None:
    """Return the columns with these names; None where one is missing.

    Raises:
        InvalidInputError: a name stands there twice.
    """
    names = _names(table)
    if any(name not in names for name in wanted):
        return None
    for name in wanted:
        if names.count(name) > 1:
            raise InvalidInputError(
                f"{table.name}: the column {name!r} stands there {names.count(name)} times: write "
                "one file for each tool"
            )
    return [names.index(name) for name in wanted]


def _named_cells(table: Table) -> list[int] | None:
    """Return the columns of the cells of a matrix, row by row, where their names have indices."""
    places: dict[tuple[int, int], int] = {}
    for column, name in enumerate(table.header or ()):
        match = MATRIX_CELL.fullmatch(name)
        if match is not None:
            places[int(match[1]), int(match[2])] = column
    for first, rows in ((0, 4), (1, 4), (0, 3), (1, 3)):
        wanted = [(first + i, first + j) for i in range(rows) for j in range(4)]
        if len(places) == len(wanted) and all(place in places for place in wanted):
            return [places[place] for place in wanted]
    return None


def _values(table: Table, columns: Sequence[int], width: int) -> tuple[Floats, Ints]:
    """Return the numbers of all rows that have some, and these rows."""
    names = _names(table)
    state = next((names.index(name) for name in STATES if name in names), None)
    values: list[list[float]] = []
    rows: list[int] = []
    for i, row in enumerate(table.rows):
        if len(row) != width:
            raise InvalidInputError(f"{table.where(i)}: expected {width} cells, got {len(row)}")
        cells = [row[k] for k in columns]
        if not any(cells) or (state is not None and row[state].lower() not in GOOD_STATES):
            continue
        bad = next((cell for cell in cells if not is_number(cell)), None)
        if bad is not None:
            raise InvalidInputError(f"{table.where(i)}: expected a number, got {bad[:40]!r}")
        values.append([float(cell) for cell in cells])
        rows.append(i)
    return np.array(values).reshape(-1, len(columns)), np.array(rows, dtype=np.int64)


def _from_quaternions(table: Table, values: Floats, rows: Ints, *, named: bool) -> Floats:
    """Return matrices (n, 4, 4) from rows of a quaternion wxyz and a position, or as unnamed."""
    far = _beyond(values) | np.isnan(values).all(axis=1)
    values = np.where(far[:, None], 0.0, values)
    some = (values != 0.0).any(axis=1)
    if named or _off_unit(values[some, :4]) < _off_unit(values[some, 3:]):
        q, p = values[:, :4], values[:, 4:]
    else:
        q, p = values[:, [6, 3, 4, 5]], values[:, :3]
    lengths = np.linalg.norm(q, axis=1)
    bad = np.flatnonzero((np.abs(lengths - 1.0) > UNIT) & (lengths > 0.0) | ~np.isfinite(lengths))
    if len(bad):
        raise InvalidInputError(
            f"{table.where(int(rows[bad[0]]))}: expected a quaternion of length 1, got one of "
            f"{lengths[bad[0]]:.4g}; name the columns qw, qx, qy, qz, x, y, z if they are in "
            "another order"
        )
    matrices = np.zeros((len(values), 4, 4))
    there = lengths > 0.0
    matrices[there, :3, :3] = Rotation.from_quat(q[there], scalar_first=True).as_matrix()
    matrices[there, :3, 3] = p[there]
    matrices[:, 3, 3] = 1.0
    return matrices


def _off_unit(q: Floats) -> float:
    """Return how far quaternions (n, 4) are from length 1 (median)."""
    return float(np.median(np.abs(np.linalg.norm(q, axis=1) - 1.0))) if len(q) else np.inf


def _numbers(table: Table, rows: Ints) -> Ints:
    """Return the numbers of frames where a column has them and they grow, else those of rows."""
    names = _names(table)
    column = next((names.index(name) for name in FRAMES if name in names), None)
    if column is not None:
        cells = [table.rows[i][column] for i in rows.tolist()]
        if all(cell.isascii() and cell.isdigit() and len(cell) <= 15 for cell in cells):
            numbers = np.array([int(cell) for cell in cells], dtype=np.int64)
            if (np.diff(numbers) > 0).all():
                return numbers
    return rows
