"""Poses recorded elsewhere: what kind of file it is, its contents say."""

import re
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from rona_core.devices.files.ndi_rom import rom_positions
from rona_core.devices.files.poses.bags import read_bag
from rona_core.devices.files.poses.marker_positions import (
    MarkerGeometryFile,
    checked_geometry,
    fit_frames,
    read_geometry_table,
    read_marker_frames,
)
from rona_core.devices.files.poses.pose_arrays import is_of_arrays, read_tables
from rona_core.devices.files.poses.pose_columns import (
    CELLS,
    NAME,
    PoseLayout,
    PoseTable,
    chosen,
    read_columns,
)
from rona_core.devices.files.poses.pose_matrices import (
    poses_from_matrices,
    require_millimetres,
    seen_poses,
)
from rona_core.devices.files.poses.sequences import NO_CLOCK, is_sequence, read_sequence
from rona_core.devices.files.ros_bags import is_bag
from rona_core.devices.files.size_limits import open_zip, read_file, read_member
from rona_core.devices.files.text_tables import NamedFile, Table, read_table
from rona_core.devices.recording import RecordedTool, Recording
from rona_core.devices.samples import ToolTrack
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.pose import ROTATION_TOLERANCE

PoseKind = Literal[
    "matrix files", "rows of poses", "marker positions", "sequence", "arrays", "ROS recording"
]
SINGLE = ("marker positions", "sequence", "ROS recording")  # of which there is one file at a time
EXPECTED = "a file with poses, or a folder of them"
MAX_UNPACKED_BYTES = 256 * 1024**2  # of all files of a zip together
MAX_TEXT_BYTES = 16 * 1024**2  # of all tables together: 50 000 poses with all digits
MAX_MEMBERS = 20_000
BESIDES = "metadata.yaml"  # in the folder of a ROS 2 bag
PLAIN = PoseLayout()


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPoses:
    """Poses of one or several tools, as files gave them."""

    name: str  # of the file, or the first of several
    kind: PoseKind
    recording: Recording  # without a clock it counts seconds: frame k is at k s
    frame: str | None  # that the poses are in; None where the file does not name it
    clocked: bool  # the file has times, and they grow
    rounding: float  # how far the rotations were from rigid; they have been made so
    notes: tuple[str, ...]  # what was changed
    geometry_marker: Floats | None = None  # (m, 3) marker positions, where they are known


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPivot:
    """Poses of a marker that were recorded while its tip rested."""

    poses: RecordedPoses
    track: ToolTrack

    @property
    def direction_known(self) -> bool:
        """Whether the file names the two frames of its poses."""
        return self.poses.frame is not None


def pose_files(paths: Sequence[Path]) -> list[NamedFile]:
    """Return the contents of files, and of those in folders in the order of their numbers.

    Raises:
        InvalidInputError: a file that is not there, or an empty folder.
    """
    found: list[NamedFile] = []
    for path in paths:
        inner = [path]
        if path.is_dir():
            inner = [p for p in path.iterdir() if p.is_file() and not p.name.startswith(".")]
            inner = sorted((p for p in inner if p.name != BESIDES), key=lambda p: _natural(p.name))
            if not inner:
                raise InvalidInputError(f"there are no files in the folder {path}")
        found += (NamedFile(str(p), read_file(p, EXPECTED)) for p in inner)
    return found


def _natural(name: str) -> list[int | str]:
    # text and numbers by turns, so that like meets like
    return [int(word) if word.isdigit() else word for word in re.split(r"([0-9]+)", name)]


def read_poses(
    files: Sequence[NamedFile | Path | str],
    layout: PoseLayout = PLAIN,
    *,
    geometry: NamedFile | None = None,
    dof: int = 6,
) -> RecordedPoses:
    """Read the poses of all tools in a recording.

    Args:
        files: One matrix each; or tables of poses, arrays, frames of single markers in mm
            (``frame,marker,x,y,z``), a sequence of PLUS, a recording of ROS. A zip or a folder
            stands for the files in it.
        layout: What the files do not say.
        geometry: Markers of the tool, CSV ``marker,x,y,z`` in mm or ``.rom``.
        dof: 6, or 5 for markers on one line.

    Raises:
        InvalidInputError: what was expected, what came, in which file and line; or what the file
            leaves open, with the options that say it.
        DegenerateGeometryError: markers that determine no pose.
    """
    if dof not in (5, 6):
        raise InvalidInputError(f"dof must be 6 or 5, not {dof}")
    given = [
        one
        for file in files
        for one in ([file] if isinstance(file, NamedFile) else pose_files([Path(file)]))
    ]
    unpacked = [inner for file in given for inner in _unpacked(file)]
    if not unpacked:
        raise InvalidInputError("expected at least one file with poses, got none")
    _check_text(unpacked)
    markers = None if geometry is None else read_geometry(geometry)
    read = [(file, *_kind(file, layout)) for file in unpacked]
    first, kind, table = read[0]
    _require_one_kind([(file.name, its_kind) for file, its_kind, _ in read])
    known = None if markers is None else readonly(markers.positions_marker)
    if kind == "sequence":
        held = read_sequence(first, layout.frame)
        return RecordedPoses(
            first.name, kind, held.recording, held.frame, held.clocked, 0.0, (), known
        )
    if kind == "marker positions" and table is not None:
        return _of_markers(table, markers, dof, layout)
    name = first.name if len(read) == 1 else f"{first.name} and {len(read) - 1} more files"
    parts = [_read(file, its_kind, its_table, layout) for file, its_kind, its_table in read]
    return replace(_assembled(name, kind, parts, layout), geometry_marker=known)


def read_pivot(
    files: Sequence[NamedFile | Path | str],
    layout: PoseLayout = PLAIN,
    *,
    geometry: NamedFile | None = None,
    usual: str | None = None,
    dof: int = 6,
) -> RecordedPivot:
    """Read the poses of a pivot, as ``read_poses`` does; a pivot needs no clock.

    Args:
        files: As there.
        layout: As there; ``tool`` says which is meant where there are several.
        geometry: As there.
        usual: The tool that is meant where several are there and none is named.
        dof: As there.

    Raises:
        InvalidInputError: as there; or metres, or a tool that was never seen.
        DegenerateGeometryError: markers that determine no pose.
    """
    found = read_poses(files, layout, geometry=geometry, dof=dof)
    track = found.recording.track(chosen_tool(found.recording, layout.tool, usual, found.name))
    _require_seen(len(track.times_s), found.name)
    require_millimetres(track.Ts_tracker_marker.translations, found.name)
    return RecordedPivot(found, track)


def require_stroke(found: RecordedPoses) -> None:
    """Refuse poses that cannot be a stroke over bone or a path.

    Raises:
        InvalidInputError: they have no times, or are in another frame than the tracker's.
    """
    if found.frame not in (None, "Tracker") and found.kind == "sequence":
        raise InvalidInputError(
            f"{found.name}: expected transforms like StylusToTrackerTransform, got poses in "
            f"{found.frame}: a stroke is mapped by the registration of the tracker"
        )
    if not found.clocked:
        raise InvalidInputError(f"{found.name}: {NO_CLOCK}")


def chosen_tool(recording: Recording, tool: str | None, usual: str | None, name: str) -> str:
    """Return which tool of a recording is meant: the one named, else the only or the usual one.

    Raises:
        InvalidInputError: it is not there, or several are and none is named.
    """
    tools = [column.tool for column in recording.tools]
    if tool is None and len(tools) > 1 and usual in tools:
        return usual
    return chosen(tools, tool, f"{name}: expected one of its tools", "tool")


def read_geometry(file: NamedFile) -> MarkerGeometryFile:
    """Read the markers of a tool from CSV rows ``marker,x,y,z`` or an NDI ``.rom``.

    The markers of a ``.rom`` have no names: they belong to those of the frames in order.

    Raises:
        InvalidInputError: damaged, or not such a file.
    """
    _check_text([file])
    if file.name.lower().endswith(".rom"):
        return MarkerGeometryFile(
            None, checked_geometry(rom_positions(file.data, file.name), file.name)
        )
    return read_geometry_table(file)


def _require_seen(n: int, what: str) -> None:
    if not n:
        raise InvalidInputError(
            f"{what}: the marker was seen in no frame; expected rows with a pose, not only those "
            "that stand for none (empty, zeros, the identity, MISSING or -3.697314E28)"
        )


def _require_one_kind(names_and_kinds: list[tuple[str, PoseKind]]) -> None:
    """Refuse files of different kinds, and several of a kind that comes in one file."""
    first, kind = names_and_kinds[0]
    for other, its_kind in names_and_kinds[1:]:
        if its_kind != kind:
            raise InvalidInputError(
                f"expected files of one kind, got {kind} in {first} and {its_kind} in {other}"
            )
        if kind in SINGLE:
            raise InvalidInputError(
                f"expected one file with {kind} at a time, got {first} and {other}"
            )


def _kind(file: NamedFile, layout: PoseLayout) -> tuple[PoseKind, Table | None]:
    if is_sequence(file):
        return "sequence", None
    if is_bag(file):
        return "ROS recording", None
    if is_of_arrays(file):
        return "arrays", None
    table = read_table(file)
    header = table.header or ()
    if "marker" in header and not any(name in header for name in ("qx", "qw", "q0", "m00")):
        return "marker positions", table
    if not table.rows:
        raise InvalidInputError(f"{file.name}: expected rows of numbers below the header, got none")
    if layout.columns is None and not header and len(table.rows[0]) in (4, 5):
        return ("matrix files" if len(table.rows[0]) == 4 else "marker positions"), table
    return "rows of poses", table


# ------------------------------------------------------------------ tables and arrays


def _read(
    file: NamedFile, kind: PoseKind, table: Table | None, layout: PoseLayout
) -> tuple[Table, PoseTable]:
    """Return the poses of one file, and a table that says where they stand."""
    if kind == "ROS recording":
        table = read_bag(file)
    elif kind == "matrix files" and table is not None:
        table = _of_matrices(table)
    if table is not None:
        return table, read_columns(table, layout)
    tables = read_tables(file)
    parts = {key: read_columns(one, layout) for key, one in tables.items()}
    (first, *_), found = parts.values(), next(iter(parts.values()))
    if len({len(part.rows) for part in parts.values()}) > 1:
        counts = ", ".join(f"{key} {len(part.rows)}" for key, part in parts.items())
        raise InvalidInputError(
            f"{file.name}: its arrays have different numbers of poses ({counts}): write a file for "
            "each tool"
        )
    single = {
        (key if len(part.matrices) == 1 else f"{key}_{tool}") if len(parts) > 1 else tool: matrices
        for key, part in parts.items()
        for tool, matrices in part.matrices.items()
    }
    return next(iter(tables.values())), replace(first, matrices=single, frame=found.frame)


def _of_matrices(table: Table) -> Table:
    """Return a table with a matrix in each row, of one with a matrix in 4 rows, or 3."""
    numbers, n = table.numbers(4), len(table.rows)
    size = 4 if n % 4 == 0 and (n % 3 or (numbers[3::4] == (0.0, 0.0, 0.0, 1.0)).all()) else 3
    if n % size:
        raise InvalidInputError(f"{table.name}: expected 4 rows of 4 numbers (or 3), got {n} rows")
    rows = tuple(sum(table.rows[i : i + size], ()) for i in range(0, n, size))
    return Table(table.name, CELLS[: 4 * size], rows, table.lines[::size])


def _assembled(
    name: str, kind: PoseKind, parts: list[tuple[Table, PoseTable]], layout: PoseLayout
) -> RecordedPoses:
    """Return the poses of all files in order."""
    tables = [table for _, table in parts]
    if len({tuple(table.matrices) for table in tables}) > 1:
        raise InvalidInputError(f"{name}: the files have different tools")
    places = [(table, int(row)) for table, found in parts for row in found.rows]
    n, one = len(places), tables[0] if len(tables) == 1 else None
    numbers = None if one is None or one.numbers is None else one.numbers
    if numbers is None or not (np.diff(numbers) > 0).all():
        numbers = np.arange(n)
    times = None if one is None else one.times_s
    clocked = times is not None and bool((np.diff(times) > 0.0).all())
    columns: list[RecordedTool] = []
    rounding = 0.0
    for tool in tables[0].matrices:
        matrices = np.concatenate([table.matrices[tool] for table in tables])
        seen = seen_poses(matrices)
        rows = np.flatnonzero(seen)

        def where(k: int, rows: Ints = rows) -> str:
            table, row = places[rows[k]]
            return table.where(row)

        poses, off = poses_from_matrices(matrices[rows], where)
        rounding = max(rounding, off)
        alone = layout.tool if len(tables[0].matrices) == 1 and tool == NAME else None
        statuses = tuple(np.where(seen, "ok", "out_of_view").tolist())
        no_rms = np.zeros(n), np.zeros(n, dtype=np.bool_)
        columns.append(RecordedTool(alone or tool, statuses, poses, *no_rms))
    _require_seen(sum(len(column.Ts_tracker_marker) for column in columns), name)
    notes = [f"Positions in {tables[0].unit} were made mm."] if tables[0].unit != "mm" else []
    if rounding > ROTATION_TOLERANCE:
        notes.append(f"Rotations were off by up to {rounding:.1g} and were made orthogonal.")
    recording = Recording(
        numbers,
        times if clocked and times is not None else (numbers - numbers[:1]).astype(np.float64),
        tuple(columns),
        n,
    )
    return RecordedPoses(name, kind, recording, tables[0].frame, clocked, rounding, tuple(notes))


def _of_markers(
    table: Table, markers: MarkerGeometryFile | None, dof: int, layout: PoseLayout
) -> RecordedPoses:
    """Return the poses that fit the positions of single markers."""
    frames = read_marker_frames(table)
    found = fit_frames(frames, markers, dof)
    n = len(found.numbers)
    column = RecordedTool(
        layout.tool or NAME,
        ("ok",) * n,
        found.fits.Ts_b_a,
        readonly(found.fits.rms_mm.copy()),
        readonly(np.ones(n, dtype=np.bool_)),
    )
    times = (found.numbers - found.numbers[:1]).astype(np.float64)
    recording = Recording(found.numbers, times, (column,), len(frames.numbers))
    geometry = readonly(found.positions_marker)
    kind: PoseKind = "marker positions"
    return RecordedPoses(table.name, kind, recording, None, False, 0.0, (), geometry)


# ------------------------------------------------------------------ files


def _check_text(files: Sequence[NamedFile]) -> None:
    total = sum(len(f.data) for f in files if not (is_sequence(f) or is_bag(f) or is_of_arrays(f)))
    if total > MAX_TEXT_BYTES:
        raise InvalidInputError(
            f"{files[0].name} and what came with it are {total / 1e6:.0f} MB of text: at most "
            f"{MAX_TEXT_BYTES / 1e6:.0f} are read; leave out frames, or write fewer digits"
        )


def _unpacked(file: NamedFile) -> list[NamedFile]:
    """Return the files in a zip, or the file itself."""
    if not file.name.lower().endswith(".zip"):
        return [file]
    found: list[NamedFile] = []
    left = MAX_UNPACKED_BYTES
    with open_zip(file.data, f"{file.name} is not a readable zip") as archive:
        members = [m for m in archive.infolist() if not m.is_dir() and not _is_hidden(m)]
        if len(members) > MAX_MEMBERS:
            raise InvalidInputError(
                f"{file.name} holds {len(members)} files: {MAX_MEMBERS} are allowed"
            )
        for member in members:
            inner = NamedFile(f"{file.name}:{member.filename}", read_member(archive, member, left))
            left -= len(inner.data)
            found.append(inner)
    if not found:
        raise InvalidInputError(f"{file.name} is empty: expected files with poses in it")
    return found


def _is_hidden(member: zipfile.ZipInfo) -> bool:
    return any(part.startswith((".", "__MACOSX")) for part in member.filename.split("/"))
