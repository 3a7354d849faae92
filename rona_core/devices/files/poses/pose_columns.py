"""Columns of a table as poses, by the names of the columns or by what a person says of them.

Where neither says it and the numbers allow several readings, the refusal is a question that names
the options.
"""

import itertools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.devices.files.poses.pose_matrices import beyond, seen_poses
from rona_core.devices.files.text_tables import Table, is_number
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import ROUNDING

NAME = "marker"  # of the tool in files that do not say it
MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
UNITS = {*MM, *SECONDS, "rad"}
LONGEST_S = 1e11  # since 1970; larger numbers are thousandths of a second, or of these
UNIT = 1e-2  # the length of a quaternion may differ from 1 by this
LOOKED_AT = 200  # rows by which columns without names are compared
POSITION = ("x", "y", "z")
QUATERNION = ("qw", "qx", "qy", "qz")
VECTOR, ANGLES = ("vx", "vy", "vz"), ("rx", "ry", "rz")
CELLS = tuple(f"m{i}{j}" for i in range(4) for j in range(4))
ROTATION = tuple(f"m{i}{j}" for i in range(3) for j in range(3))
KINDS = (
    (*QUATERNION, *POSITION),
    CELLS,
    CELLS[:12],
    (*ROTATION, *POSITION),
    (*VECTOR, *POSITION),
)
OF_POSITION = {"t", "p", "pos", "position", "trans", "translation", "tvec"}
OF_QUATERNION = {"q", "quat", "quaternion", "orientation", "rot", "rotation"}
OF_VECTOR = {"rotvec", "rvec", "rodrigues", "axisangle"}
OF_MATRIX = {"m", "r", "t", "h", "tf", "matrix", "mat", "pose", "transform", *OF_QUATERNION}
ORDERS = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}
STATES = {"state", "status", "valid", "visible", "tracked"}
GOOD_STATES = {"ok", "1", "true", "valid", "visible", "tracked", "partially out of volume"}
FRAMES = {"frame", "framenumber", "frameno"}
TIMES = {"t", "time", "times", "timestamp", "timestamps", "stamp", "seconds"}
TOOLS = {"tool", "toolid", "toolname", "handle", "porthandle", "name", "body", "rigidbody"}
EXPECTED = (
    "expected 16 or 12 numbers (a matrix, row by row), 7 (x, y, z and a quaternion qx, qy, qz, qw, "
    "or this one as qw, qx, qy, qz first), either after a time or not, columns with names (qw, qx, "
    "qy, qz, x, y, z), 4 numbers (a row of a matrix), or frame,marker,x,y,z"
)
NAME_THEM = "name the columns in the first line of the file, or say them: --columns"


@dataclass(frozen=True, slots=True)
class PoseLayout:
    """What a person says of a file of poses, where the file does not say it."""

    columns: str | None = None  # names of all columns, separated by commas or spaces; - for others
    quaternion: Literal["wxyz", "xyzw"] | None = None  # order, where no names have it
    unit: Literal["mm", "cm", "m"] | None = None  # of positions; None: as named, else mm
    frame: str | None = None  # that the poses are in, where the file has several
    tool: str | None = None  # which is meant, where the file has several


@dataclass(frozen=True, slots=True, eq=False)
class PoseTable:
    """Poses of the tools in a table of n rows."""

    matrices: dict[str, Floats]  # of each tool (n, 4, 4) in mm, all NaN where it was not seen
    rows: Ints  # (n,) of the table, for messages
    numbers: Ints | None  # (n,) growing, of frames; None where none are there
    times_s: Floats | None  # (n,); None where none are there
    frame: str | None  # that the poses are in
    unit: str  # of the positions in the file


@dataclass(frozen=True, slots=True)
class _Group:
    """Columns of one tool."""

    prefix: str
    parts: dict[str, int]

    def kind(self) -> tuple[str, ...]:
        """Return the parts that make a pose, in order; none where some are missing."""
        return next((kind for kind in KINDS if all(part in self.parts for part in kind)), ())


def read_columns(table: Table, layout: PoseLayout) -> PoseTable:
    """Read the poses of all tools in a table, a row or a block of columns each.

    Raises:
        InvalidInputError: columns that leave open how they are meant, with the options; cells that
            are no numbers; or quaternions of another length; it says where.
    """
    table = _named(table, layout)
    header = table.header or ()
    for i, row in enumerate(table.rows):
        if len(row) != len(header):
            raise InvalidInputError(
                f"{table.where(i)}: expected {len(header)} cells, got {len(row)}"
            )
    names, groups = [_words(name) for name in header], _groups(table, layout)
    unit = _unit(table, groups, layout)
    single: dict[str, Floats] = {}
    for tool, group in groups.items():
        single[tool] = _matrices(table, group, _state(names, group))
        single[tool][:, :3, 3] *= MM[unit]
    is_frame = _column(names, lambda key: key.endswith("frameid") and "child" not in key)
    frame, keep = _frame(table, is_frame, layout)
    rows = np.arange(len(table.rows))
    found = PoseTable(single, rows, _numbers(table, names), _times(table, names), frame, unit)
    found = _selected(found, keep)
    tools = _column(names, lambda key: key in TOOLS or key.endswith("childframeid"))
    if tools is None or len(groups) > 1:
        return found
    cells = [table.rows[i][tools] for i in found.rows.tolist()]
    return _by_tool(found, cells) if 1 <= len(set(cells)) < len(cells) else found


# ------------------------------------------------------------------ names


def _words(name: str) -> list[str]:
    """Return the words and numbers of a name, without the unit behind them."""
    words = re.findall(r"[a-z]+|\d+", name)
    return words[:-1] if len(words) > 1 and words[-1] in UNITS else words


def _part(words: list[str], quaternion: str | None) -> tuple[str, str] | None:
    """Return the prefix of a column and which part of a pose it is; None if it is none."""
    *before, last = words or [""]
    of = before[-1] if before else ""
    rest, part = before[:-1], ""
    if last.isdigit() and (cell := re.fullmatch(r"([0-4])([0-4])", last)):
        rest = before[:-1] if of in OF_MATRIX else before
        part = f"m{cell[1]}{cell[2]}"
    elif last.isdigit() and len(last) == 1:
        k = int(last)
        if of.isdigit() and len(of) == 1:
            rest = rest[:-1] if rest and rest[-1] in OF_MATRIX else rest
            part = f"m{of}{k}"
        elif of in ORDERS and k < 4:
            rest = rest[:-1] if rest and rest[-1] in OF_QUATERNION else rest
            part = QUATERNION[ORDERS[of].index(k)]
        elif of in OF_VECTOR and k < 3:
            part = VECTOR[k]
        elif of in OF_QUATERNION and k < 4:
            order = ORDERS[quaternion] if quaternion else ORDERS["wxyz"] if of == "q" else None
            part = f"q?{k}" if order is None else QUATERNION[order.index(k)]
        elif of in OF_POSITION and k < 3:
            part = POSITION[k]
    elif last in ("x", "y", "z") and of in OF_VECTOR:
        part = "v" + last
    elif last in ("x", "y", "z", "w") and of in OF_QUATERNION:
        part = "q" + last
    elif last in POSITION:
        rest, part = (rest if of in OF_POSITION else before), last
    elif found := re.fullmatch(r"([tpqr]|rotvec|rvec)([wxyz])", last):
        rest = before
        start = {"t": "", "p": "", "q": "q", "r": "r"}.get(found[1], "v")
        part = start + found[2]
    elif last == "w":
        rest, part = before, "qw"
    return ("_".join(rest), part) if part else None


def _groups(table: Table, layout: PoseLayout) -> dict[str, _Group]:
    """Return the columns of each tool.

    Raises:
        InvalidInputError: no tool has all of a pose, or a name stands there twice.
    """
    header = table.header or ()
    ports = [i for i, name in enumerate(header) if name.startswith("port")]  # blocks of NDI
    bounds = [*ports, len(header)] if ports else [0, len(header)]
    found: dict[str, _Group] = {}
    for start, end in itertools.pairwise(bounds):
        groups: dict[str, dict[str, int]] = {}
        for column in range(start, end):
            part = _part(_words(header[column]), layout.quaternion)
            if part is None:
                continue
            held = groups.setdefault(part[0], {})
            if part[1] in held and not ports:  # in those of NDI single markers follow the pose
                raise InvalidInputError(
                    f"{table.name}: the column {header[column]!r} stands there twice: write one "
                    f"file for each tool, or {NAME_THEM}"
                )
            held.setdefault(part[1], column)
        for prefix, parts in _merged(groups).items():
            group = _Group(prefix, _from_zero(parts))
            if group.kind():
                port = table.rows[0][start] or header[start] if ports else ""
                found[port or prefix or NAME] = group
            elif not ports:
                _question(table, group)
    if not found:
        raise InvalidInputError(
            f"{table.name}: no pose was found in the columns {', '.join(header)[:200]}: "
            f"{NAME_THEM} (such as time,x,y,z,qx,qy,qz,qw, with - for those that are something "
            "else)"
        )
    return found


def _merged(groups: dict[str, dict[str, int]]) -> dict[str, dict[str, int]]:
    """Return one group where one has the positions alone and another one the rotations."""
    places = [k for k, parts in groups.items() if set(parts) == set(POSITION)]
    turns = [k for k, parts in groups.items() if len(parts) in (3, 4, 9) and "x" not in parts]
    if len(groups) == 2 and len(places) == len(turns) == 1:
        return {"": groups[places[0]] | groups[turns[0]]}
    return groups


def _from_zero(parts: dict[str, int]) -> dict[str, int]:
    """Return the parts with cells of matrices that count from 0."""
    cells = [part for part in parts if re.fullmatch(r"m\d\d", part)]
    if not cells or any("0" in cell for cell in cells):
        return parts
    return {
        f"m{int(part[1]) - 1}{int(part[2]) - 1}" if part in cells else part: column
        for part, column in parts.items()
    }


def _question(table: Table, group: _Group) -> None:
    """Ask how columns are meant whose names leave it open."""
    if "q?0" in group.parts:
        raise InvalidInputError(
            f"{table.name}: in which order are the four numbers of the quaternion? Say it: "
            "--quaternion wxyz (real part first) or --quaternion xyzw (real part last)"
        )
    if all(part in group.parts for part in (*ANGLES, *POSITION)):
        raise InvalidInputError(
            f"{table.name}: are rx, ry, rz a rotation vector (axis times angle in rad, as of "
            "Universal Robots) or Euler angles? For a vector name them rotvec_x, rotvec_y, "
            "rotvec_z in the file or by --columns; Euler angles are not read, write matrices or "
            "quaternions"
        )


# ------------------------------------------------------------------ columns without names


def _named(table: Table, layout: PoseLayout) -> Table:
    """Return the table with names for all columns: those of a person, of the file, or found."""
    width = len(table.rows[0])
    if layout.columns is not None:
        names = tuple(re.split(r"[,;\s]+", layout.columns.strip().lower()))
        if len(names) != width:
            raise InvalidInputError(
                f"{table.name}: --columns has {len(names)} names, the file has {width} columns"
            )
        return replace(table, header=names)
    if table.header is None:
        return replace(table, header=_found_names(table, layout))
    if table.header[0] == "tools":  # NDI ends rows where no more markers follow
        wide = len(table.header)
        rows = tuple((*row, *("" for _ in range(wide - len(row))))[:wide] for row in table.rows)
        return replace(table, rows=rows)
    return table


def _readings(quaternion: str | None) -> list[str]:
    """Return the names that columns without any may have, the usual ones first."""
    last = " ".join(QUATERNION[k] for k in np.argsort(ORDERS[quaternion or "xyzw"]))
    first = " ".join(QUATERNION[k] for k in np.argsort(ORDERS[quaternion or "wxyz"]))
    short = [f"x y z {last}", f"{first} x y z"]
    long = [" ".join(CELLS), " ".join(CELLS[:12]), f"{' '.join(ROTATION)} x y z"]
    two = [
        " ".join(f"{tool}_{name}" for tool in ("first", "second") for name in one.split())
        for one in (*short, *long)
    ]
    timed = [f"time {one}" for one in (*short, *long, *two)]
    return [*short, *long, *two, *timed, *(f"{one} -" for one in short)]


def _found_names(table: Table, layout: PoseLayout) -> tuple[str, ...]:
    """Return names for columns without any.

    Raises:
        InvalidInputError: no reading has so many columns, or several are as good.
    """
    width = len(table.rows[0])
    if width == 6:
        raise InvalidInputError(
            f"{table.where(0)}: six numbers are a position and a rotation vector, or Euler angles. "
            "For a vector in rad say --columns x,y,z,rotvec_x,rotvec_y,rotvec_z; "
            "Euler angles are not read, write matrices or quaternions"
        )
    readings = [r for r in _readings(layout.quaternion) if len(r.split()) == width]
    if not readings:
        raise InvalidInputError(f"{table.where(0)}: {EXPECTED}; got {width} cells")
    alone = len(readings) == 1 and "first" not in readings[0]
    good = readings if alone else [r for r in readings if _is_good(table, r)]
    if len(good) > 1:
        options = " or ".join(f'--columns "{reading}"' for reading in good)
        raise InvalidInputError(
            f"{table.name}: how are its {width} columns meant? Several readings fit. Say it: "
            f"{options}; or write the names in the first line"
        )
    if not good and "first" in readings[0]:
        raise InvalidInputError(f"{table.where(0)}: {EXPECTED}; got {width} cells")
    return tuple((good or readings)[0].split())


def _is_good(table: Table, reading: str) -> bool:
    """Return whether the numbers of a table have the rotations that a reading says."""
    names = tuple(reading.split())
    some = replace(table, header=names, rows=table.rows[:LOOKED_AT])
    for group in _groups(some, PoseLayout()).values():
        kind = group.kind()
        numbers = [
            [float(row[group.parts[part]]) for part in kind]
            for row in some.rows
            if len(row) == len(names) and all(is_number(cell) for cell in row if cell)
            if all(row[group.parts[part]] for part in kind)
        ]
        values = np.array(numbers).reshape(-1, len(kind))
        values = values[~beyond(values) & ~np.isnan(values).any(axis=1) & values.any(axis=1)]
        if not len(values):
            continue
        if kind[0] == "qw":
            off = np.abs(np.linalg.norm(values[:, :4], axis=1) - 1.0)
            if np.median(off) > UNIT:
                return False
            continue
        matrices = _from_parts(kind, values)
        matrices = matrices[seen_poses(matrices)]
        R = matrices[:, :3, :3]
        off = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        if len(off) and np.median(off) > ROUNDING:
            return False
    return True


# ------------------------------------------------------------------ numbers


def _matrices(table: Table, group: _Group, state: int | None) -> Floats:
    """Return the matrices (n, 4, 4) of one tool, not checked yet, NaN where it was not seen."""
    kind = group.kind()
    columns = [group.parts[part] for part in kind]
    values = np.full((len(table.rows), len(columns)), np.nan)
    for i, row in enumerate(table.rows):
        cells = [row[k] for k in columns]
        if not any(cells) or (state is not None and row[state].lower() not in GOOD_STATES):
            continue
        bad = next((cell for cell in cells if not is_number(cell)), None)
        if bad is not None:
            raise InvalidInputError(f"{table.where(i)}: expected a number, got {bad[:40]!r}")
        values[i] = [float(cell) for cell in cells]
    values[beyond(values)] = np.nan
    if kind[0] == "qw":
        lengths = np.linalg.norm(values[:, :4], axis=1)
        values[lengths == 0.0] = np.nan
        some = ~np.isnan(values).all(axis=1)
        bad_rows = np.flatnonzero(some & ~(np.abs(lengths - 1.0) <= UNIT) & (lengths != 0.0))
        if len(bad_rows):
            raise InvalidInputError(
                f"{table.where(int(bad_rows[0]))}: expected a quaternion of length 1, got one of "
                f"{lengths[bad_rows[0]]:.4g}; if the columns are in another order, {NAME_THEM}"
            )
    return _from_parts(kind, values)


def _from_parts(kind: Sequence[str], values: Floats) -> Floats:
    """Return the matrices (n, 4, 4) of rows (n, k) in the order of one of ``KINDS``."""
    n = len(values)
    matrices = np.tile(np.eye(4), (n, 1, 1))
    if kind[0] == "m00" and "x" not in kind:
        matrices.reshape(n, 16)[:, : len(kind)] = values
    elif kind[0] == "m00":
        matrices[:, :3, :3], matrices[:, :3, 3] = values[:, :9].reshape(n, 3, 3), values[:, 9:]
    else:
        some = np.flatnonzero(np.isfinite(values).any(axis=1))
        matrices[:, :3] = np.nan
        turn, place = values[some, : len(kind) - 3], values[some, len(kind) - 3 :]
        whole = np.asarray(np.isfinite(turn).all(axis=1), dtype=np.bool_)
        turn = np.where(whole[:, None], turn, 1.0)
        if kind[0] == "vx":
            turned = Rotation.from_rotvec(turn)
        else:
            turned = Rotation.from_quat(turn, scalar_first=True)
        R = turned.as_matrix().reshape(-1, 3, 3)
        matrices[some, :3, :3] = np.where(whole[:, None, None], R, np.nan)
        matrices[some, :3, 3] = place
    return matrices


def _unit(table: Table, groups: dict[str, _Group], layout: PoseLayout) -> str:
    """Return the unit of positions: what a person says, else what the names of columns say."""
    header = table.header or ()
    said = {
        words[-1]
        for group in groups.values()
        for part in (*POSITION, "m03", "m13", "m23")
        if part in group.parts
        and len(words := re.findall(r"[a-z]+|\d+", header[group.parts[part]])) > 1
        and words[-1] in MM
    }
    if layout.unit is None and len(said) > 1:
        raise InvalidInputError(
            f"{table.name}: positions in {' and '.join(sorted(said))}: write one unit, or say it: "
            "--unit mm, cm or m"
        )
    return layout.unit or (said.pop() if said else "mm")


def _column(names: list[list[str]], wanted: Callable[[str], bool]) -> int | None:
    """Return the first column whose name, without spaces, is wanted."""
    return next((i for i, words in enumerate(names) if wanted("".join(words))), None)


def _state(names: list[list[str]], group: _Group) -> int | None:
    """Return the column that says whether a tool was seen: in its block, else of all."""
    own = [i for i, words in enumerate(names) if words and words[-1] in STATES]
    first, last = min(group.parts.values()), max(group.parts.values())
    near = [i for i in own if "_".join(names[i][:-1]) == group.prefix and group.prefix]
    near += [i for i in own if len(names[i]) == 1 and i < last and first - i <= 5]
    return max(near) if near else own[0] if len(own) == 1 else None


def _numbers(table: Table, names: list[list[str]]) -> Ints | None:
    """Return the numbers of frames (n,) where a column has them."""
    column = _column(names, FRAMES.__contains__)
    cells = [row[column] for row in table.rows] if column is not None else [""]
    if not all(cell.isascii() and cell.isdigit() and len(cell) <= 15 for cell in cells):
        return None
    return np.array([int(cell) for cell in cells], dtype=np.int64)


def _times(table: Table, names: list[list[str]]) -> Floats | None:
    """Return the times (n,) in s where a column has them."""
    column = _column(names, lambda key: key in TIMES or key.endswith("headerstamp"))
    if column is None or not all(is_number(row[column]) for row in table.rows):
        return None
    first = float(table.rows[0][column])
    times = np.array([float(row[column]) - first for row in table.rows])
    unit = re.findall(r"[a-z]+", (table.header or ())[column])[-1]
    factor = SECONDS.get(unit, 1.0)
    while unit not in SECONDS and abs(first) * factor > LONGEST_S:
        factor /= 1000.0
    return times * factor if np.isfinite(times).all() else None


def _frame(table: Table, column: int | None, layout: PoseLayout) -> tuple[str | None, Bools]:
    """Return the frame of the poses, and which rows (n,) are in it.

    Raises:
        InvalidInputError: there are several and none is named, or that one is not there.
    """
    if column is None:
        return None, np.ones(len(table.rows), dtype=np.bool_)
    cells = [row[column] for row in table.rows]
    what = f"{table.name}: its poses are in the frames"
    frame = chosen(list(dict.fromkeys(cells)), layout.frame, what, "frame")
    return frame, np.array([cell == frame for cell in cells])


def chosen(names: Sequence[str], wanted: str | None, what: str, option: str) -> str:
    """Return the name that is wanted, or the only one; part of a name is enough.

    Raises:
        InvalidInputError: there are several and none is named, or that one is not there.
    """
    if wanted is None and len(names) == 1:
        return names[0]
    low = (wanted or "").lower()
    same = [n for n in names if n.lower() == low] or [n for n in names if low and low in n.lower()]
    if len(same) != 1:
        got = "none was named" if wanted is None else f"got {wanted!r}"
        raise InvalidInputError(f"{what} {', '.join(names)}; {got}: say which by --{option}")
    return same[0]


def _selected(found: PoseTable, keep: Bools) -> PoseTable:
    """Return the rows (n,) that are kept."""
    numbers = None if found.numbers is None else found.numbers[keep]
    times = None if found.times_s is None else found.times_s[keep]
    single = {tool: matrices[keep] for tool, matrices in found.matrices.items()}
    return replace(found, matrices=single, rows=found.rows[keep], numbers=numbers, times_s=times)


def _by_tool(found: PoseTable, cells: Sequence[str]) -> PoseTable:
    """Return a table with a row for each frame, of one with a row for each tool and frame."""
    (matrices,) = found.matrices.values()
    key = found.times_s if found.numbers is None else found.numbers
    if key is None:  # each tool has its frames in order
        counts: dict[str, int] = {}
        key = np.array([counts.update({c: counts.get(c, -1) + 1}) or counts[c] for c in cells])
    _, first, frame = np.unique(key, return_index=True, return_inverse=True)
    single: dict[str, Floats] = {}
    for tool in dict.fromkeys(cells):
        own = np.array([cell == tool for cell in cells])
        single[tool] = np.full((len(first), 4, 4), np.nan)
        single[tool][frame[own]] = matrices[own]
    numbers = None if found.numbers is None else found.numbers[first]
    times = None if found.times_s is None else found.times_s[first]
    return replace(found, matrices=single, rows=found.rows[first], numbers=numbers, times_s=times)
