"""Positions of single markers in text files, and the marker body that fits them."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial.distance import pdist

from rona_core.devices.files.text_tables import NamedFile, Table, is_number, read_table
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.rigid_fit import MIN_WIDTH, ManyFits, fit_line_many, fit_rigid_many

LEAST = {6: 3, 5: 2}  # markers that a frame must have seen, by degrees of freedom
MAX_OFF_MM = 2.0  # a distance of two markers, or the fit, may be off by this (median over frames)
METRES = (0.8e-3, 1.25e-3)  # a distance over the known one where the file has metres
OFF_LINE_MM = 0.5  # markers of a 5D tool may lie beside its line by this
MIRRORED = 2.0  # the fit of a right geometry is not as much worse than that of its mirror image
MIRRORED_MM = 0.2  # ... and this, which markers on one plane make of their noise
CLOSEST_MM = 2.0  # two markers of a tool are farther apart than this


@dataclass(frozen=True, slots=True, eq=False)
class MarkerGeometryFile:
    """Markers of a tool: names and positions (m, 3) in the frame ``marker``, in mm."""

    names: tuple[str, ...] | None  # None where the file has none: then by order
    positions_marker: Floats


@dataclass(frozen=True, slots=True, eq=False)
class MarkerFrames:
    """What n frames saw of m markers."""

    name: str  # of the file
    numbers: Ints  # (n,) growing
    names: tuple[str, ...]  # (m,)
    points_tracker: Floats  # (n, m, 3), 0 where a marker was not seen
    seen: Bools  # (n, m)


@dataclass(frozen=True, slots=True, eq=False)
class FittedFrames:
    """The k frames that saw enough markers, and the poses that follow."""

    fits: ManyFits  # T_tracker_marker of each frame
    numbers: Ints  # (k,)
    positions_marker: Floats  # (m, 3) the geometry used


def checked_geometry(positions_marker: Floats, name: str) -> Floats:
    """Return marker positions (m, 3), m >= 3, that can be those of a tool in mm.

    Raises:
        InvalidInputError: too few, two at one place, or metres.
    """
    m = len(positions_marker)
    if m < 3:
        raise InvalidInputError(f"{name}: expected at least 3 markers, got {m}")
    distances = pdist(positions_marker)
    if distances.max() < CLOSEST_MM:
        raise InvalidInputError(
            f"{name}: its markers are at most {distances.max():.3g} mm apart. Millimetres are "
            "expected, these look like metres: multiply them by 1000"
        )
    if distances.min() < CLOSEST_MM:
        i, j = list(combinations(range(m), 2))[int(distances.argmin())]
        raise InvalidInputError(
            f"{name}: markers {i + 1} and {j + 1} are {distances.min():.2g} mm apart: one of them "
            "stands there twice"
        )
    return positions_marker


def fit_frames(frames: MarkerFrames, geometry: MarkerGeometryFile | None, dof: int) -> FittedFrames:
    """Return the pose of each frame that saw enough markers.

    Without a geometry that of the first complete frame is taken: origin at the first marker by
    name, x towards the second, z normal to the first three (5D: z towards the last).

    Raises:
        InvalidInputError: names or distances that do not fit the geometry, or no frame that saw
            enough markers.
        DegenerateGeometryError: markers of a 6D tool on one line.
    """
    positions = _own_geometry(frames, dof) if geometry is None else _ordered(frames, geometry)
    enough = frames.seen.sum(axis=1) >= LEAST[dof]
    _require_some(enough, frames, dof)
    if dof == 6:
        _require_body(positions, frames.name)
        enough &= _broad(positions, frames.seen)
        _require_some(enough, frames, dof)
    else:
        _require_line(positions, frames.name)
    _require_distances(frames, positions)
    points, seen, numbers = frames.points_tracker[enough], frames.seen[enough], frames.numbers
    try:
        if dof == 6:
            fits = fit_rigid_many(positions, points, seen)
        else:
            fits = fit_line_many(positions[:, 2], points, seen)
    except DegenerateGeometryError as error:
        row = error.data.get("row", 0)
        number = int(numbers[enough][row if isinstance(row, int) else 0])
        raise DegenerateGeometryError(f"{frames.name}, frame {number}: {error}") from error
    if dof == 6:
        _require_handedness(fits, positions, points, seen, frames.name)
    off_mm = float(np.median(fits.rms_mm))
    if off_mm > MAX_OFF_MM:
        raise InvalidInputError(
            f"{frames.name}: the markers fit the geometry to {off_mm:.1f} mm only, "
            f"{MAX_OFF_MM:g} are allowed: name the markers as in the geometry, or load that of "
            "this tool"
        )
    return FittedFrames(fits, numbers[enough], positions)


def _require_handedness(
    fits: ManyFits, positions: Floats, points: Floats, seen: Bools, name: str
) -> None:
    """Refuse markers that fit the mirror image of their geometry; on one plane both fit alike."""
    mirrored = fit_rigid_many(positions * (1.0, 1.0, -1.0), points, seen)
    off, mirrored_off = (float(np.median(fit.rms_mm)) for fit in (fits, mirrored))
    if off > MIRRORED * mirrored_off + MIRRORED_MM:
        raise InvalidInputError(
            f"{name}: the markers fit the mirror image of the geometry to {mirrored_off:.2g} mm, "
            f"itself to {off:.2g} mm: one axis is mirrored in either. Change the sign of one "
            "coordinate in the file that is wrong",
            change="mirrored",
        )


def _own_geometry(frames: MarkerFrames, dof: int) -> Floats:
    complete = np.flatnonzero(frames.seen.all(axis=1))
    if not len(complete):
        raise InvalidInputError(
            f"{frames.name}: no frame saw all {len(frames.names)} markers "
            f"({', '.join(frames.names)}), so give the geometry of the tool in a file"
        )
    points = checked_geometry(frames.points_tracker[complete[0]], frames.name)
    offsets = points - points[0]
    if dof == 5:
        along = np.linalg.norm(offsets, axis=1)
        return np.column_stack((np.zeros((len(points), 2)), along))
    _require_body(points, frames.name)
    x = offsets[1] / np.linalg.norm(offsets[1])
    normals = np.cross(x, offsets[2:])
    z = normals[np.argmax(np.linalg.norm(normals, axis=1) > MIN_WIDTH * np.ptp(offsets))]
    z = z / np.linalg.norm(z)
    return offsets @ np.column_stack((x, np.cross(z, x), z))


def _ordered(frames: MarkerFrames, geometry: MarkerGeometryFile) -> Floats:
    """Return the positions of the markers in the order of the frames' names."""
    positions, names = geometry.positions_marker, geometry.names
    if names is None:
        if len(positions) != len(frames.names):
            raise InvalidInputError(
                f"{frames.name} has the markers {', '.join(frames.names)}, "
                f"the geometry has {len(positions)} markers"
            )
        return positions
    unknown = [name for name in frames.names if name not in names]
    if unknown:
        raise InvalidInputError(
            f"{frames.name}: the marker {unknown[0]!r} is not in the geometry, which has "
            f"{', '.join(names)}"
        )
    return positions[[names.index(name) for name in frames.names]]


def _require_some(enough: Bools, frames: MarkerFrames, dof: int) -> None:
    if not enough.any():
        raise InvalidInputError(
            f"{frames.name}: no frame saw {LEAST[dof]} of the markers {', '.join(frames.names)}"
            + (" that are not on one line" if dof == 6 else "")
        )


def _is_line(positions: Floats) -> bool:
    s = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    return bool(s[1] <= MIN_WIDTH * s[0])


def _broad(positions: Floats, seen: Bools) -> Bools:
    """Return for which frames (n,) the markers that were seen do not lie on one line."""
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    broad = [int(p.sum()) >= LEAST[6] and not _is_line(positions[p]) for p in patterns]
    return np.array(broad, dtype=np.bool_)[which.ravel()]


def _require_body(positions: Floats, name: str) -> None:
    if _is_line(positions):
        raise DegenerateGeometryError(
            f"{name}: the markers lie on one line, so the turn about it cannot be seen: it is a 5D "
            "tool"
        )


def _require_line(positions: Floats, name: str) -> None:
    beside = float(np.linalg.norm(positions[:, :2], axis=1).max())
    if beside > OFF_LINE_MM:
        raise InvalidInputError(
            f"{name}: the markers of a 5D tool lie on its z axis, one is {beside:.1f} mm beside it"
        )


def _require_distances(frames: MarkerFrames, positions: Floats) -> None:
    """Refuse markers whose distances from one another are not those of the geometry."""
    worst: tuple[float, float, float, int, int] = (0.0, 0.0, 0.0, 0, 0)
    ratios: list[float] = []
    for i, j in combinations(range(len(positions)), 2):
        both = frames.seen[:, i] & frames.seen[:, j]
        if both.any():
            known = float(np.linalg.norm(positions[i] - positions[j]))
            apart = frames.points_tracker[both, i] - frames.points_tracker[both, j]
            found = float(np.median(np.linalg.norm(apart, axis=1)))
            ratios.append(found / max(known, 1e-9))
            worst = max(worst, (abs(found - known), found, known, i, j))
    off_mm, found, known, i, j = worst
    if off_mm <= MAX_OFF_MM:
        return
    if all(METRES[0] < ratio < METRES[1] for ratio in ratios):
        raise InvalidInputError(
            f"{frames.name}: all distances are a thousandth of those of the geometry. Millimetres "
            "are expected, these look like metres: multiply the positions by 1000"
        )
    raise InvalidInputError(
        f"{frames.name}: markers {frames.names[i]} and {frames.names[j]} are {found:.1f} mm apart "
        f"in the frames, {known:.1f} mm in the geometry: wrong tool, or wrong names?"
    )


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
