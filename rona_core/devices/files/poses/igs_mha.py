"""Reader and writer of ``.igs.mha`` sequence files of PLUS (3D Slicer, SimpleITK).

A MetaImage whose header holds, for each frame, a matrix and a status for every tool; the image
itself is one dark pixel a frame. Poses are those of the tool's marker in the tracker, in mm.
Format: the PLUS user manual, page "Sequence file".
"""

import math
import re
from dataclasses import dataclass
from typing import TypeVar, get_args

import numpy as np

from rona_core.devices.files.poses.pose_tables import poses_from_matrices, seen_poses
from rona_core.devices.recording import RecordedTool, Recording
from rona_core.devices.samples import WITH_POSE, ToolStatus
from rona_core.devices.settings import TOOLS
from rona_core.errors import InvalidInputError

Number = TypeVar("Number", int, float)
END = re.compile(rb"^ElementDataFile[ \t]*=[ \t]*([^\r\n]*?)[ \t]*(?:\r?\n|\Z)", re.MULTILINE)
FRAME_FIELD = re.compile(r"Seq_Frame([0-9]{1,9})_(\w+)")
MAX_HEADER_BYTES = 48 * 1024**2
MOST_DIGITS = 15  # of a whole number; exact as a float too


@dataclass(frozen=True, slots=True, eq=False)
class Header:
    """Fields of the file, and those of every frame from 0 on."""

    name: str  # of the file, for messages
    fields: dict[str, str]
    frames: tuple[dict[str, str], ...]

    @property
    def n_frames(self) -> int:
        """How many frames there are."""
        return len(self.frames)

    def names_with(self, ending: str) -> tuple[str, ...]:
        """Return what stands before ``ending`` in fields of frames, in order of appearance."""
        found: dict[str, None] = {}
        for frame in self.frames:
            for field in frame:
                if field.endswith(ending) and field != ending:
                    found[field.removesuffix(ending)] = None
        return tuple(found)

    def whole(self, field: str) -> int:
        """Return a field of the file that is a whole number, 0 or more.

        Raises:
            InvalidInputError: it is missing, or something else.
        """
        value = self.fields.get(field, "missing")
        if not _is_whole(value):
            raise InvalidInputError(
                f"{self.name}, {field}: expected a whole number, got {value[:40]!r}"
            )
        return int(value)

    def text(self, frame: int, field: str) -> str:
        """Return a field of a frame.

        Raises:
            InvalidInputError: it is missing.
        """
        if field not in self.frames[frame]:
            raise InvalidInputError(f"{self.name}, frame {frame}: {field} is missing")
        return self.frames[frame][field]

    def number(self, frame: int, field: str, kind: type[Number]) -> Number:
        """Return a field of a frame as a finite number; errors as in ``text``, or another value."""
        value = self.text(frame, field)
        try:
            result = kind(value) if kind is float or _is_whole(value.removeprefix("-")) else None
        except ValueError:
            result = None
        if result is None or not math.isfinite(result):
            words = "a whole number" if kind is int else "a finite number"
            raise InvalidInputError(
                f"{self.name}, frame {frame}, {field}: expected {words}, got {value[:40]!r}"
            )
        return result

    def column(
        self, field: str, kind: type[Number], *, optional: bool = False
    ) -> list[Number] | None:
        """Return a number of every frame; None if it is optional and no frame has it."""
        if optional and not any(field in frame for frame in self.frames):
            return None
        return [self.number(i, field, kind) for i in range(self.n_frames)]

    def matrix(self, frame: int, field: str) -> list[float]:
        """Return the sixteen numbers of a transform; errors as in ``number``."""
        words = self.text(frame, field).split()
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != 16:
            got = f"{len(words)} words" if len(words) != 16 else "other words"
            raise InvalidInputError(
                f"{self.name}, frame {frame}, {field}: expected 16 numbers, got {got}"
            )
        return values


def read_header(data: bytes, name: str) -> Header:
    """Read the header of a sequence file.

    Raises:
        InvalidInputError: not a sequence file, damaged, or one whose pixels are in another file.
    """
    if not data:
        raise InvalidInputError(f"{name} is empty: expected a sequence file (.igs.mha)")
    if not re.match(rb"ObjectType[ \t]*=[ \t]*Image\b", data):
        raise InvalidInputError(
            f"{name}: expected a sequence file that begins with 'ObjectType = Image', "
            f"got {data[:24]!r}"
        )
    end = END.search(data, 0, MAX_HEADER_BYTES)
    if end is None and len(data) > MAX_HEADER_BYTES:
        raise InvalidInputError(
            f"{name}: no 'ElementDataFile = LOCAL' in its first {MAX_HEADER_BYTES / 1e6:.0f} MB: "
            "its header is longer than what is read; cut the recording into parts"
        )
    if end is None:
        raise InvalidInputError(
            f"{name} is cut off: expected 'ElementDataFile = LOCAL' at the end of its header"
        )
    where = end.group(1).decode("ascii", "replace")
    if where != "LOCAL":
        raise InvalidInputError(
            f"{name}: expected its pixels in the same file (ElementDataFile = LOCAL), got "
            f"{where!r}: save it as .igs.mha"
        )
    header = _parsed(data[: end.start()], name)
    stated, there = _least_pixel_bytes(header), len(data) - end.end()
    if there < stated:
        raise InvalidInputError(
            f"{name} is damaged: expected at least {stated} bytes of pixels, got {there}"
        )
    return header


def _least_pixel_bytes(header: Header) -> int:
    """Return how many bytes of pixels must follow; fewer tell that the file was cut off."""
    if header.fields.get("CompressedData", "False").lower() == "true":
        return header.whole("CompressedDataSize") if "CompressedDataSize" in header.fields else 0
    if header.fields.get("ElementType") in ("MET_OTHER", "MET_NONE"):
        return 0  # what PLUS writes where there is no image
    return math.prod(int(word) for word in header.fields["DimSize"].split())


def _parsed(text: bytes, name: str) -> Header:
    try:
        lines = text.decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise InvalidInputError(f"{name}: its header is not text ({error})") from error
    fields: dict[str, str] = {}
    frames: dict[int, dict[str, str]] = {}
    for number, line in enumerate(lines, start=1):
        key, equals, value = line.partition("=")
        key = key.strip()
        if not equals:
            if key:
                raise InvalidInputError(
                    f"{name}, line {number}: expected 'name = value', got {line[:40]!r}"
                )
            continue
        match = FRAME_FIELD.fullmatch(key)
        if key.startswith("Seq_Frame") and match is None:
            raise InvalidInputError(
                f"{name}, line {number}: expected a field like Seq_Frame0000_Timestamp, "
                f"got {key[:60]!r}"
            )
        held, field = fields, key
        if match is not None:
            held, field = frames.setdefault(int(match[1]), {}), match[2]
        if field in held:
            raise InvalidInputError(f"{name}, line {number}: {key} stands there twice")
        held[field] = value.strip()
    header = Header(name, fields, tuple(frames[i] for i in sorted(frames)))
    _check_frames(header, sorted(frames))
    return header


def _is_whole(word: str) -> bool:
    return word.isascii() and word.isdigit() and len(word) <= MOST_DIGITS


def _check_frames(header: Header, indices: list[int]) -> None:
    words = header.fields.get("DimSize", "missing").split()
    if not words or not all(_is_whole(word) for word in words):
        raise InvalidInputError(
            f"{header.name}, DimSize: expected whole numbers, got {' '.join(words)[:40]!r}"
        )
    sizes = [int(word) for word in words]
    if header.whole("NDims") != len(sizes):
        raise InvalidInputError(
            f"{header.name}: NDims says {header.fields['NDims']}, DimSize has {len(sizes)} numbers"
        )
    kinds = header.fields.get("Kinds", "").lower().split()
    along = [k for k, kind in enumerate(kinds) if kind in ("list", "time") and k < len(sizes)]
    expected = sizes[along[-1]] if along else sizes[-1]
    if not indices:
        raise InvalidInputError(
            f"{header.name}: expected fields like Seq_Frame0000_Timestamp, got an image without any"
        )
    gap = next((i for i, index in enumerate(indices) if i != index), None)
    if gap is not None:
        raise InvalidInputError(
            f"{header.name}: frame {gap} is missing, frame {indices[gap]} is there"
        )
    if len(indices) != expected:
        raise InvalidInputError(
            f"{header.name}: DimSize says {expected} frames, there are fields of {len(indices)}"
        )


SUFFIX = ".igs.mha"
TO_TRACKER = "ToTrackerTransform"
STATUS = "ToTrackerTransformStatus"
TO_ANY = re.compile(r"(\w+?)(To[A-Z]\w*?Transform)")
RMS = "ToTrackerRmsErrorMm"  # ours; others keep such fields without looking at them
REASON = "ToTrackerReason"  # ours: why a tool was not seen, or only in part
CAPTURE_FRAMES = "CaptureFrames"  # ours: frames of the capture, also those that are not in here
OWN_STATUSES: tuple[ToolStatus, ...] = get_args(ToolStatus)
# what PLUS writes as the status of a transform, without the TOOL_ of its older versions
STATUSES: dict[str, ToolStatus] = {
    "OK": "ok",
    "INVALID": "out_of_view",
    "MISSING": "out_of_view",
    "UNKNOWN": "out_of_view",
    "OUT_OF_VIEW": "out_of_view",
    "OUT_OF_VOLUME": "out_of_volume",
    "REQ_TIMEOUT": "out_of_view",
    "PATH_NOT_FOUND": "out_of_view",
}
NO_POSE = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"  # what PLUS writes for a tool that is not seen


def write_igs_mha(recording: Recording) -> bytes:
    """Return a recording as the bytes of a sequence file; numbers keep every bit.

    Raises:
        InvalidInputError: a tool whose name is not letters and digits.
    """
    names = [_written_name(column.tool) for column in recording.tools]
    n = len(recording)
    lines = [
        "ObjectType = Image",
        "NDims = 3",
        "AnatomicalOrientation = RAI",
        "BinaryData = True",
        "BinaryDataByteOrderMSB = False",
        f"{CAPTURE_FRAMES} = {recording.n_frames}",
        "CenterOfRotation = 0 0 0",
        "CompressedData = False",
        f"DimSize = 1 1 {n}",
        "ElementNumberOfChannels = 1",
        "ElementSpacing = 1 1 1",
        "ElementType = MET_UCHAR",
        "Kinds = domain domain list",
        "Offset = 0 0 0",
        "TransformMatrix = 1 0 0 0 1 0 0 0 1",
        "UltrasoundImageOrientation = MF",
        "UltrasoundImageType = BRIGHTNESS",
    ]
    written = [_frame_lines(*pair) for pair in zip(names, recording.tools, strict=True)]
    numbers, times_s = recording.numbers.tolist(), recording.times_s.tolist()
    for i in range(n):
        prefix = f"Seq_Frame{i:04d}_"
        lines.append(f"{prefix}FrameNumber = {numbers[i]}")
        for tool in written:
            lines += (prefix + line for line in tool[i])
        lines.append(f"{prefix}Timestamp = {times_s[i]!r}")
        lines.append(f"{prefix}ImageStatus = INVALID")  # there is no picture, only the poses
    lines.append("ElementDataFile = LOCAL\n")
    return "\n".join(lines).encode("ascii") + bytes(n)


def _written_name(tool: str) -> str:
    if not (tool.isascii() and tool.isalnum() and tool[0].isalpha()) or "ToTracker" in tool:
        raise InvalidInputError(
            f"the tool {tool!r} cannot stand in a sequence file: letters and digits are expected"
        )
    return tool.capitalize() if tool in TOOLS else tool  # others expect names like StylusToTracker


def _frame_lines(name: str, column: RecordedTool) -> list[list[str]]:
    """Return the fields of one tool for every frame."""
    poses = column.Ts_tracker_marker
    matrices = np.concatenate((poses.rotations, poses.translations[:, :, None]), axis=2)
    values, errors = matrices.reshape(-1, 12).tolist(), column.rms_error_mm.tolist()
    frames: list[list[str]] = []
    for i, row in enumerate(column.rows.tolist()):
        if row < 0:
            lines = [f"{name}{TO_TRACKER} = {NO_POSE}", f"{name}{STATUS} = INVALID"]
        else:
            numbers = " ".join(map(repr, values[row]))
            lines = [f"{name}{TO_TRACKER} = {numbers} 0 0 0 1", f"{name}{STATUS} = OK"]
        if column.statuses[i] != "ok":
            lines.append(f"{name}{REASON} = {column.statuses[i]}")
        if column.rms_known[i]:
            lines.append(f"{name}{RMS} = {errors[i]!r}")
        frames.append(lines)
    return frames


# ------------------------------------------------------------------ reading


def read_igs_mha(data: bytes, name: str = "recording.igs.mha", *, pivot: bool = False) -> Recording:
    """Read a sequence file: one of ours, or one of PLUS, compressed or not, with or without images.

    Times and frame numbers are those of the file; frames without a number count from 0. The tools
    of RONA are known whatever the case of their letters.

    A pivot needs no tracker and no clock: with ``pivot`` the poses may be in another frame, such as
    a reference body, if it is one for all tools, and frames whose times do not grow count seconds.

    Raises:
        InvalidInputError: not such a file, damaged, or with fields that do not fit; it says where.
    """
    header = read_header(data, name)
    n = header.n_frames
    ending = TO_TRACKER
    names = header.names_with(ending)
    if not names and pivot:
        ending = _only_ending(header) or ending
        names = header.names_with(ending)
    if not names:
        others = ", ".join(header.names_with("Transform")) or "none at all"
        raise InvalidInputError(
            f"{name}: expected transforms like StylusToTrackerTransform, got {others}"
        )
    own = [_tool_name(written) for written in names]
    if len(set(own)) != len(own):
        raise InvalidInputError(f"{name}: two tools have the same name in {', '.join(names)}")
    columns = [
        _read_tool(header, written, tool, ending) for written, tool in zip(names, own, strict=True)
    ]
    numbers = header.column("FrameNumber", int, optional=True)
    times_s = np.array(header.column("Timestamp", float), dtype=np.float64)
    if pivot and not (np.diff(times_s) > 0.0).all():
        times_s = np.arange(n, dtype=np.float64)
    n_frames = n
    if CAPTURE_FRAMES in header.fields:
        n_frames = header.whole(CAPTURE_FRAMES)
    try:
        return Recording(
            numbers=np.arange(n) if numbers is None else np.array(numbers, dtype=np.int64),
            times_s=times_s,
            tools=tuple(columns),
            n_frames=n_frames,
        )
    except InvalidInputError as error:
        raise InvalidInputError(f"{name}: {error}") from error


def _tool_name(written: str) -> str:
    return next((tool for tool in TOOLS if tool == written.lower()), written)


def _only_ending(header: Header) -> str | None:
    """Return how all transforms of all frames end, such as ToReferenceTransform; None if not so."""
    fields = {field for frame in header.frames for field in frame}
    found = {match[2] for field in fields if (match := TO_ANY.fullmatch(field)) is not None}
    return found.pop() if len(found) == 1 else None


def _read_tool(header: Header, written: str, tool: str, ending: str) -> RecordedTool:
    n = header.n_frames
    statuses: list[ToolStatus] = [_status(header, i, written, ending) for i in range(n)]
    seen = [i for i, status in enumerate(statuses) if status in WITH_POSE]
    field = f"{written}{ending}"
    matrices = np.array([header.matrix(i, field) for i in seen], dtype=np.float64)
    matrices = matrices.reshape(-1, 4, 4)
    there = seen_poses(matrices)  # some programs call the identity OK
    for i in np.flatnonzero(~there).tolist():
        statuses[seen[i]] = "out_of_view"
    seen = [i for i, status in enumerate(statuses) if status in WITH_POSE]
    poses, _ = poses_from_matrices(
        matrices[there], lambda k: f"{header.name}, frame {seen[k]}, {field}"
    )
    errors = np.zeros(n)
    known = np.zeros(n, dtype=np.bool_)
    for i in range(n):
        if f"{written}{RMS}" in header.frames[i]:
            errors[i], known[i] = header.number(i, f"{written}{RMS}", float), True
    return RecordedTool(tool, tuple(statuses), poses, errors, known)


def _status(header: Header, frame: int, written: str, ending: str) -> ToolStatus:
    field = f"{written}{ending}Status"
    word = header.text(frame, field)
    status = STATUSES.get(word.upper().removeprefix("TOOL_"))
    if status is None:
        raise InvalidInputError(
            f"{header.name}, frame {frame}, {field}: expected OK or INVALID, got {word!r}"
        )
    reason = header.frames[frame].get(f"{written}{REASON}")
    if reason is None:
        return status
    for own in OWN_STATUSES:
        if own == reason and (own in WITH_POSE) == (status == "ok"):
            return own
    raise InvalidInputError(
        f"{header.name}, frame {frame}, {written}{REASON}: expected one of "
        f"{', '.join(OWN_STATUSES)}, got {reason!r}"
    )
