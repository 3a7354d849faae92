"""Reader and writer of sequence files of PLUS (3D Slicer, SimpleITK): .igs.mha, .mhd, .nrrd.

A MetaImage or NRRD whose header holds, for each frame, a matrix for every tool, and as a rule its
status and a time; the image itself is not read, in what is written it is one dark pixel a frame.
``StylusToTrackerTransform`` is the pose of Stylus in Tracker, in mm. Format: the PLUS user manual,
page "Sequence file".
"""

import math
import re
from dataclasses import dataclass
from typing import get_args

import numpy as np

from rona_core.devices.files.poses.pose_columns import chosen
from rona_core.devices.files.poses.pose_matrices import poses_from_matrices, seen_poses
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.recording import RecordedTool, Recording
from rona_core.devices.samples import WITH_POSE, ToolStatus
from rona_core.devices.settings import TOOLS
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats

MAX_HEADER_BYTES = 48 * 1024**2
END = re.compile(
    rb"^ElementDataFile[ \t]*=[ \t]*([^\r\n]*?)[ \t]*(?:\r?\n|\Z)|\A(NRRD.*?)\r?\n\r?\n",
    re.MULTILINE | re.DOTALL,
)
KEY = re.compile(r"([^=:]+?)[ \t]*(?:=|:=|:)[ \t]*(.*)")
FRAME_FIELD = re.compile(r"Seq_Frame([0-9]{1,9})_(\w+)")
TRANSFORM = re.compile(r"(\w+?)(?:To([A-Z]\w*))?Transform")
MOST_DIGITS = 15  # of a whole number; exact as a float too
NO_PIXELS = ("MET_OTHER", "MET_NONE")  # what PLUS writes where there is no image

SUFFIX = ".igs.mha"
TO_TRACKER = "ToTrackerTransform"
STATUS = "ToTrackerTransformStatus"
RMS_END = "RmsErrorMm"  # ours; others keep such fields without looking at them
REASON_END = "Reason"  # ours: why a tool was not seen, or only in part
NO_CLOCK = (
    "a stroke or a path needs times, and the time of each frame must be above that of the frame "
    "before: write them as Seq_Frame0000_Timestamp, or in a column 'time'"
)
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
            lines.append(f"{name}ToTracker{REASON_END} = {column.statuses[i]}")
        if column.rms_known[i]:
            lines.append(f"{name}ToTracker{RMS_END} = {errors[i]!r}")
        frames.append(lines)
    return frames


# ------------------------------------------------------------------ reading


@dataclass(frozen=True, slots=True, eq=False)
class Sequence:
    """What a sequence file holds."""

    recording: Recording  # frames without times count seconds
    frame: str | None  # that the poses are in, such as Tracker or Reference, where it is named
    clocked: bool  # the file has times, and they grow


def read_igs_mha(data: bytes, name: str = "recording.igs.mha") -> Recording:
    """Read a sequence file of a tracker; errors as in ``read_sequence``, and without a clock."""
    found = read_sequence(NamedFile(name, data), frame="Tracker")
    if not found.clocked:
        raise InvalidInputError(f"{name}: {NO_CLOCK}")
    return found.recording


def is_sequence(file: NamedFile) -> bool:
    """Return whether a file is a MetaImage or NRRD, by its first bytes or its name."""
    named = file.name.lower().endswith((".mha", ".mhd", ".nrrd"))
    return named or file.data.startswith((b"ObjectType", b"NRRD"))


def read_sequence(file: NamedFile, frame: str | None = None) -> Sequence:
    """Read a sequence file: one of ours, or one of PLUS, compressed or not, with or without images.

    Frames without a number count from 0. The tools of RONA are known whatever the case of their
    letters. Where the poses are in several frames, that of the tracker is meant.

    Args:
        file: Its contents.
        frame: That the poses are to be in.

    Raises:
        InvalidInputError: not such a file, damaged, or with fields that do not fit; it says where.
    """
    name = file.name
    fields, frames = _header(file)
    tools: dict[str, dict[str, str]] = {}  # frame -> tool -> field
    for field in dict.fromkeys(field for held in frames for field in held):
        if (match := TRANSFORM.fullmatch(field)) is not None:
            own = next((tool for tool in TOOLS if tool == match[1].lower()), match[1])
            inside = tools.setdefault(match[2] or "", {})
            if own in inside:
                raise InvalidInputError(f"{name}: two tools have the same name in {field}")
            inside[own] = field
    if not tools:
        raise InvalidInputError(
            f"{name}: expected transforms like StylusToTrackerTransform, got none at all"
        )
    wanted = "Tracker" if frame is None and "Tracker" in tools else frame
    into = chosen(list(tools), wanted, f"{name}: its poses are in the frames", "frame")
    columns = tuple(_tool(frames, name, tool, field) for tool, field in tools[into].items())
    numbers, times = (_column(frames, name, field) for field in ("FrameNumber", "Timestamp"))
    clocked = times is not None and bool((np.diff(times) > 0.0).all())
    count = np.arange(len(frames))
    try:
        recording = Recording(
            count if numbers is None else numbers.astype(np.int64),
            times if clocked and times is not None else count.astype(np.float64),
            columns,
            _whole(fields, CAPTURE_FRAMES, name) if CAPTURE_FRAMES in fields else len(frames),
        )
    except InvalidInputError as error:
        raise InvalidInputError(f"{name}: {error}") from error
    return Sequence(recording, into or None, clocked)


def _header(file: NamedFile) -> tuple[dict[str, str], list[dict[str, str]]]:
    """Return the fields of the file, and those of each frame.

    Raises:
        InvalidInputError: not a sequence file, or a damaged one.
    """
    name, data = file.name, file.data
    nrrd = data.startswith(b"NRRD")
    if not nrrd and not re.match(rb"ObjectType[ \t]*=[ \t]*Image\b", data):
        raise InvalidInputError(
            f"{name}: expected a sequence file that begins with 'ObjectType = Image' or 'NRRD', "
            f"got {data[:24]!r}"
            if data
            else f"{name} is empty: expected a sequence file (.igs.mha)"
        )
    end = END.search(data, 0, MAX_HEADER_BYTES)
    if end is None and nrrd and len(data) <= MAX_HEADER_BYTES:
        text, pixels = data, None  # a header alone, its pixels in another file
    elif end is None:
        long = len(data) > MAX_HEADER_BYTES
        raise InvalidInputError(
            f"{name}: its header is longer than the {MAX_HEADER_BYTES / 1e6:.0f} MB that are read: "
            "cut the recording into parts"
            if long
            else f"{name} is cut off: expected 'ElementDataFile = LOCAL' at the end of its header"
        )
    else:
        text = end.group(2) or data[: end.start()]
        pixels = len(data) - end.end() if end.group(1) == b"LOCAL" else None
    fields, frames = _parsed(text, name)
    expected = _frames_stated(fields, name, nrrd)
    gap = next((i for i, index in enumerate(sorted(frames)) if i != index), None)
    if gap is not None:
        raise InvalidInputError(f"{name}: frame {gap} is missing, later ones are there")
    if len(frames) != expected:
        raise InvalidInputError(
            f"{name}: {'sizes' if nrrd else 'DimSize'} says {expected} frames, there are fields of "
            f"{len(frames)}, such as Seq_Frame0000_Timestamp"
        )
    least = 0 if nrrd or pixels is None else _least_pixel_bytes(fields, name)
    if pixels is not None and pixels < least:
        raise InvalidInputError(
            f"{name} is damaged: expected at least {least} bytes of pixels, got {pixels}"
        )
    return fields, [frames[i] for i in sorted(frames)]


def _parsed(text: bytes, name: str) -> tuple[dict[str, str], dict[int, dict[str, str]]]:
    try:
        lines = text.decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise InvalidInputError(f"{name}: its header is not text ({error})") from error
    fields: dict[str, str] = {}
    frames: dict[int, dict[str, str]] = {}
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith(("#", "NRRD")):
            continue
        pair = KEY.fullmatch(line.strip())
        if pair is None:
            raise InvalidInputError(
                f"{name}, line {number}: expected 'name = value', got {line[:40]!r}"
            )
        match = FRAME_FIELD.fullmatch(pair[1])
        if pair[1].startswith("Seq_Frame") and match is None:
            raise InvalidInputError(
                f"{name}, line {number}: expected a field like Seq_Frame0000_Timestamp, "
                f"got {pair[1][:60]!r}"
            )
        held, field = fields, pair[1]
        if match is not None:
            held, field = frames.setdefault(int(match[1]), {}), match[2]
        if field in held:
            raise InvalidInputError(f"{name}, line {number}: {pair[1]} stands there twice")
        held[field] = pair[2].strip()
    return fields, frames


def _is_whole(word: str) -> bool:
    return word.isascii() and word.isdigit() and len(word) <= MOST_DIGITS


def _whole(fields: dict[str, str], field: str, name: str) -> int:
    value = fields.get(field, "missing")
    if not _is_whole(value):
        raise InvalidInputError(f"{name}, {field}: expected a whole number, got {value[:40]!r}")
    return int(value)


def _frames_stated(fields: dict[str, str], name: str, nrrd: bool) -> int:
    """Return how many frames the size of the image says there are."""
    field, dimension = ("sizes", "dimension") if nrrd else ("DimSize", "NDims")
    words = fields.get(field, "missing").split()
    if not words or not all(map(_is_whole, words)):
        raise InvalidInputError(
            f"{name}, {field}: expected whole numbers, got {' '.join(words)[:40]!r}"
        )
    if _whole(fields, dimension, name) != len(words):
        raise InvalidInputError(
            f"{name}: {dimension} says {fields[dimension]}, {field} has {len(words)} numbers"
        )
    kinds = fields.get("kinds" if nrrd else "Kinds", "").lower().split()
    along = [k for k, kind in enumerate(kinds) if kind in ("list", "time") and k < len(words)]
    return int(words[along[-1]] if along else words[-1])


def _least_pixel_bytes(fields: dict[str, str], name: str) -> int:
    """Return how many bytes of pixels must follow; fewer tell that the file was cut off."""
    if fields.get("CompressedData", "False").lower() == "true":
        return _whole(fields, "CompressedDataSize", name) if "CompressedDataSize" in fields else 0
    if fields.get("ElementType") in NO_PIXELS:
        return 0
    return math.prod(int(word) for word in fields["DimSize"].split())


def _column(frames: list[dict[str, str]], name: str, field: str) -> Floats | None:
    """Return a number of every frame (n,); None where no frame has it."""
    if not any(field in held for held in frames):
        return None
    return np.array([_number(held, f"{name}, frame {i}", field) for i, held in enumerate(frames)])


def _number(held: dict[str, str], where: str, field: str) -> float:
    if field not in held:
        raise InvalidInputError(f"{where}: {field} is missing")
    word, whole = held[field], field == "FrameNumber"
    try:
        value = float(word) if not whole or _is_whole(word.removeprefix("-")) else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        words = "a whole number" if whole else "a finite number"
        raise InvalidInputError(f"{where}, {field}: expected {words}, got {word[:40]!r}")
    return value


def _tool(frames: list[dict[str, str]], name: str, tool: str, field: str) -> RecordedTool:
    """Return what was seen of a tool; without any status it was where its matrix is a pose."""
    stem = field.removesuffix("Transform")
    stated = any(f"{field}Status" in held for held in frames)
    n = len(frames)
    statuses: list[ToolStatus] = []
    matrices, errors, known = np.full((n, 4, 4), np.nan), np.zeros(n), np.zeros(n, dtype=np.bool_)
    for i, held in enumerate(frames):
        where = f"{name}, frame {i}"
        statuses.append(_status(held, where, field, stem) if stated or field in held else "missing")
        if statuses[i] in WITH_POSE:
            words = held.get(field, "").split()
            try:
                matrices[i] = np.array([float(word) for word in words]).reshape(4, 4)
            except ValueError:
                got = f"{len(words)} words" if len(words) != 16 else "other words"
                raise InvalidInputError(
                    f"{where}, {field}: expected 16 numbers, got {got}"
                ) from None
        if f"{stem}{RMS_END}" in held:
            errors[i], known[i] = _number(held, where, f"{stem}{RMS_END}"), True
    there = seen_poses(matrices)  # some programs call the identity OK
    statuses = [
        "out_of_view" if s in WITH_POSE and not seen else s
        for s, seen in zip(statuses, there.tolist(), strict=True)
    ]
    rows = np.flatnonzero([status in WITH_POSE for status in statuses])
    poses, _ = poses_from_matrices(matrices[rows], lambda k: f"{name}, frame {rows[k]}, {field}")
    return RecordedTool(tool, tuple(statuses), poses, errors, known)


def _status(held: dict[str, str], where: str, field: str, stem: str) -> ToolStatus:
    if f"{field}Status" not in held:
        if any(key.endswith("TransformStatus") for key in held) or field not in held:
            raise InvalidInputError(f"{where}: {field}Status is missing")
        return "ok"
    word = held[f"{field}Status"]
    status = STATUSES.get(word.upper().removeprefix("TOOL_"))
    if status is None:
        raise InvalidInputError(f"{where}, {field}Status: expected OK or INVALID, got {word!r}")
    reason = held.get(f"{stem}{REASON_END}")
    if reason is None:
        return status
    for own in OWN_STATUSES:
        if own == reason and (own in WITH_POSE) == (status == "ok"):
            return own
    raise InvalidInputError(
        f"{where}, {stem}{REASON_END}: expected one of {', '.join(OWN_STATUSES)}, got {reason!r}"
    )
