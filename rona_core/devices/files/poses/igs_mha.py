"""Reader and writer of ``.igs.mha`` sequence files of PLUS (3D Slicer, SimpleITK).

A MetaImage whose header holds, for each frame, a matrix and a status for every tool; the image
itself is one dark pixel a frame. Poses are those of the tool's marker in the tracker, in mm.
Format: the PLUS user manual, page "Sequence file".
"""

import re
from typing import get_args

import numpy as np

from rona_core.devices.files.poses.igs_mha_header import Header, read_header
from rona_core.devices.files.poses.pose_matrices import poses_from_matrices
from rona_core.devices.files.poses.pose_tables import seen_poses
from rona_core.devices.recording import RecordedTool, Recording
from rona_core.devices.samples import WITH_POSE, ToolStatus
from rona_core.devices.settings import TOOLS
from rona_core.errors import InvalidInputError

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
