"""Reader of recorded pivots: matrices, marker positions or sequences."""

import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.devices.files.ndi_rom import rom_positions
from rona_core.devices.files.poses.igs_mha import read_igs_mha
from rona_core.devices.files.poses.marker_positions import (
    MarkerGeometryFile,
    checked_geometry,
    fit_frames,
    read_geometry_table,
    read_marker_frames,
)
from rona_core.devices.files.poses.pose_tables import (
    EXPECTED,
    is_pose_table,
    poses_from_matrices,
    read_pose_rows,
    require_millimetres,
    seen_poses,
)
from rona_core.devices.files.size_limits import open_zip, read_member
from rona_core.devices.files.text_tables import NamedFile, Table, read_table
from rona_core.devices.recording import Recording
from rona_core.devices.samples import ToolTrack
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.pose import Poses

PivotKind = Literal["matrix files", "rows of poses", "marker positions", "sequence"]
NAME = "marker"  # of the tool in files that do not say it
MAX_UNPACKED_BYTES = 256 * 1024**2  # of all files of a zip together
MAX_TEXT_BYTES = 16 * 1024**2  # of all tables together: 50 000 poses with all digits
MAX_MEMBERS = 20_000
SINGLE = ("marker positions", "sequence")  # kinds of which there is one file at a time


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPivot:
    """Poses of a marker that were recorded while its tip rested, as files gave them."""

    name: str  # of the file, or the first of several
    kind: PivotKind
    track: ToolTrack  # files without times count seconds: frame k is at k s
    geometry_marker: Floats | None  # (m, 3) marker positions, where they are known
    rounding: float  # how far the rotations were from rigid; they have been made so

    @property
    def direction_known(self) -> bool:
        """Whether the file names the two frames of its poses."""
        return self.kind == "sequence"


def read_pivot(
    files: Sequence[NamedFile],
    *,
    geometry: NamedFile | None = None,
    tool: str | None = None,
    usual: str | None = None,
    dof: int = 6,
) -> RecordedPivot:
    """Read the poses of a pivot; what kind of file it is, its contents say.

    Args:
        files: One 4 x 4 matrix each; or CSV with a pose in each row, as `read_pose_rows` reads
            it; or one CSV ``frame,marker,x,y,z`` in mm; or one ``.igs.mha``. A zip stands for the
            files in it.
        geometry: Markers of the tool, CSV ``marker,x,y,z`` in mm or ``.rom``.
        tool: Which tool of a sequence, where it has several.
        usual: The one that is meant where several are there and none is named.
        dof: 6, or 5 for markers on one line.

    Raises:
        InvalidInputError: what was expected, what came, in which file and line.
        DegenerateGeometryError: markers that determine no pose.
    """
    if dof not in (5, 6):
        raise InvalidInputError(f"dof must be 6 or 5, not {dof}")
    unpacked = [inner for file in files for inner in _unpacked(file)]
    if not unpacked:
        raise InvalidInputError("expected at least one file with poses, got none")
    _check_text(unpacked)
    markers = None if geometry is None else read_geometry(geometry)
    read = [(file, *_kind(file)) for file in unpacked]
    first, kind, table = read[0]
    _require_one_kind([(file.name, its_kind) for file, its_kind, _ in read])
    known = None if markers is None else readonly(markers.positions_marker)
    if kind == "sequence":
        recording = read_igs_mha(first.data, first.name, pivot=True)
        track = recording.track(chosen_tool(recording, tool, usual, first.name))
        _require_seen(len(track.times_s), first.name)
        require_millimetres(track.Ts_tracker_marker.translations, first.name)
        return RecordedPivot(first.name, kind, track, known, 0.0)
    if kind == "marker positions" and table is not None:
        frames = read_marker_frames(table)
        found = fit_frames(frames, markers, dof)
        poses, rms_mm = found.fits.Ts_b_a, found.fits.rms_mm
        require_millimetres(poses.translations, first.name)
        track = _track(tool or NAME, found.numbers, poses, rms_mm, len(frames.numbers))
        return RecordedPivot(first.name, kind, track, readonly(found.positions_marker), 0.0)
    what = first.name if len(read) == 1 else f"{first.name} and {len(read) - 1} more files"
    tables = [t for _, _, t in read if t is not None]
    poses, rounding, numbers, n_frames = _read_matrices(tables, kind)
    _require_seen(len(poses), what)
    require_millimetres(poses.translations, what)
    track = _track(tool or NAME, numbers, poses, np.zeros(len(poses)), n_frames)
    return RecordedPivot(what, kind, track, known, rounding)


def _require_seen(n: int, what: str) -> None:
    if not n:
        raise InvalidInputError(
            f"{what}: the marker was seen in no frame; expected rows with a pose, not only those "
            "that stand for none (empty, zeros, the identity, MISSING or -3.697314E28)"
        )


def _require_one_kind(names_and_kinds: list[tuple[str, PivotKind]]) -> None:
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


def chosen_tool(recording: Recording, tool: str | None, usual: str | None, name: str) -> str:
    """Return which tool of a recording is meant: the one named, else the only or the usual one.

    Raises:
        InvalidInputError: it is not there, or several are and none is named.
    """
    tools = [column.tool for column in recording.tools]
    if tool is None and len(tools) == 1:
        return tools[0]
    if tool is None and usual in tools:
        return usual
    match = [own for own in tools if tool is not None and own.lower() == tool.lower()]
    if not match:
        got = "none was named" if tool is None else f"got {tool!r}"
        raise InvalidInputError(f"{name}: expected one of its tools {', '.join(tools)}; {got}")
    return match[0]


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


def _track(tool: str, numbers: Ints, poses: Poses, rms_mm: Floats, n_frames: int) -> ToolTrack:
    times_s = (numbers - numbers[:1]).astype(np.float64)
    return ToolTrack(
        tool, readonly(numbers), readonly(times_s), poses, readonly(rms_mm.copy()), n_frames
    )


def _is_sequence(file: NamedFile) -> bool:
    return file.name.lower().endswith((".mha", ".mhd")) or file.data.startswith(b"ObjectType")


def _check_text(files: Sequence[NamedFile]) -> None:
    total = sum(len(file.data) for file in files if not _is_sequence(file))
    if total > MAX_TEXT_BYTES:
        raise InvalidInputError(
            f"{files[0].name} and what came with it are {total / 1e6:.0f} MB of text: at most "
            f"{MAX_TEXT_BYTES / 1e6:.0f} are read; leave out frames, or write fewer digits"
        )


def _kind(file: NamedFile) -> tuple[PivotKind, Table | None]:
    if _is_sequence(file):
        return "sequence", None
    table = read_table(file)
    if table.header is not None and "marker" in table.header:
        return "marker positions", table
    if not table.rows:
        raise InvalidInputError(f"{file.name}: expected rows of numbers below the header, got none")
    if is_pose_table(table):
        return "rows of poses", table
    width = len(table.rows[0])
    if width == 5:
        return "marker positions", table
    if width == 4:
        return "matrix files", table
    raise InvalidInputError(f"{table.where(0)}: {EXPECTED}; got {width} cells")


def _read_matrices(tables: list[Table], kind: PivotKind) -> tuple[Poses, float, Ints, int]:
    """Return all poses in order, how far from rigid, their frames, and how many frames there are.

    Rows that stand for a marker not seen are left out.
    """
    parts: list[Floats] = []
    places: list[tuple[Table, int]] = []
    frames: list[Ints] = []
    n_frames = 0
    for table in tables:
        if kind == "rows of poses":
            found = read_pose_rows(table)
            parts.append(found.matrices)
            places += [(table, i) for i in found.rows.tolist()]
            frames.append(found.numbers if len(tables) == 1 else n_frames + found.rows)
            n_frames += len(table.rows)
            continue
        numbers = table.numbers(4)
        if len(numbers) % 4:
            raise InvalidInputError(
                f"{table.name}: expected 4 rows of 4 numbers, got {len(numbers)} rows"
            )
        matrices = numbers.reshape(-1, 4, 4)
        seen = np.flatnonzero(seen_poses(matrices))
        parts.append(matrices[seen])
        places += [(table, 4 * i) for i in seen.tolist()]
        frames.append(n_frames + seen)
        n_frames += len(matrices)

    def where(k: int) -> str:
        table, row = places[k]
        return table.where(row)

    poses, rounding = poses_from_matrices(np.concatenate(parts), where)
    return poses, rounding, np.concatenate(frames), n_frames


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
