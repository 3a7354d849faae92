"""Poses in files: 4 x 4 matrices, and rows of text tables."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.devices.files.text_tables import Table, is_number
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import ROTATION_TOLERANCE, Poses

ROUNDING = 1e-3  # R R' may differ from the identity by this: files are printed with few digits
SCALE = 1e-2  # relative; a matrix whose axes agree in length to this is scaled, not sheared
NEAR_MM = 10.0  # no marker stays so close to a tracker: then the unit is metres


def poses_from_matrices(matrices: Floats, where: Callable[[int], str]) -> tuple[Poses, float]:
    """Return the poses of homogeneous matrices (n, 4, 4), and how far they were from rigid.

    Rotations that differ from rigid ones by the rounding of their digits become the nearest rigid
    ones; those that are rigid keep every bit.

    Args:
        matrices: Read row by row.
        where: Says the place of matrix i, for the message.

    Raises:
        InvalidInputError: values not finite, a last row that is not 0 0 0 1 (transposed?), or
            a rotation that is scaled, sheared or left-handed.
    """
    infinite = (~np.isfinite(matrices)).sum(axis=(1, 2)) > 0
    _refuse(infinite, matrices, where, _not_finite)
    last = np.abs(matrices[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(axis=1, initial=0.0)
    _refuse(last > ROTATION_TOLERANCE, matrices, where, _wrong_last_row)
    rotations = matrices[:, :3, :3]
    off = np.abs(rotations @ np.swapaxes(rotations, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    _refuse(off > ROUNDING, matrices, where, _not_rigid)
    _refuse(np.linalg.det(rotations) < 0.0, matrices, where, _left_handed)
    rounded = off > ROTATION_TOLERANCE / 2.0
    if rounded.any():
        u, _, vt = np.linalg.svd(rotations[rounded])
        rotations = rotations.copy()
        rotations[rounded] = u @ vt
    return Poses(rotations.copy(), matrices[:, :3, 3].copy()), float(off.max(initial=0.0))


def require_millimetres(translations: Floats, what: str) -> None:
    """Refuse positions (n, 3) of a marker before a tracker that can only be metres.

    Raises:
        InvalidInputError: none is 10 mm from the origin.
    """
    farthest = float(np.linalg.norm(translations, axis=1).max(initial=0.0))
    if len(translations) and farthest < NEAR_MM:
        raise InvalidInputError(
            f"{what}: no marker is farther than {farthest:.3g} mm from the tracker. Millimetres "
            "are expected, these look like metres: multiply the translations by 1000"
        )


def _refuse(
    bad: Bools, matrices: Floats, where: Callable[[int], str], say: Callable[[Floats], str]
) -> None:
    if bad.any():
        i = int(np.argmax(bad))
        more = int(bad.sum()) - 1
        others = f" (and {more} more)" if more else ""
        raise InvalidInputError(f"{where(i)}: {say(matrices[i])}{others}")


def _not_finite(matrix: Floats) -> str:
    value = matrix[~np.isfinite(matrix)][0]
    return f"expected finite numbers, got {value}; leave out poses that were not seen"


def _wrong_last_row(matrix: Floats) -> str:
    row = " ".join(f"{v:g}" for v in matrix[3])
    column = np.abs(matrix[:, 3] - (0.0, 0.0, 0.0, 1.0)).max()
    if column <= ROTATION_TOLERANCE:
        return (
            f"expected the last row 0 0 0 1, got {row}: the matrix is transposed. Write it row by "
            "row, with the translation in the last column"
        )
    return f"expected the last row 0 0 0 1, got {row}"


def _not_rigid(matrix: Floats) -> str:
    rotation = matrix[:3, :3]
    off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    lengths = np.linalg.norm(rotation, axis=1)
    scale = float(lengths.mean())
    square = rotation @ rotation.T / max(scale * scale, 1e-300)
    if np.abs(square - np.eye(3)).max() <= SCALE:
        return f"expected a rotation, got one scaled by {scale:.4g}: R R' is off by {off:.2g}"
    return (
        f"expected a rotation, got a matrix whose R R' differs from the identity by {off:.2g} "
        f"({ROUNDING:g} is allowed for rounding)"
    )


def _left_handed(matrix: Floats) -> str:
    determinant = float(np.linalg.det(matrix[:3, :3]))
    return (
        f"expected a right-handed rotation, got a determinant of {determinant:.3g}: one axis is "
        "mirrored"
    )


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
