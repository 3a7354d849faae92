"""Captures as files that other programs read."""

from dataclasses import dataclass

from rona_core.devices.files.poses.sequences import SUFFIX, write_igs_mha
from rona_core.devices.recording import Recording
from rona_core.devices.settings import TOOL_TITLES
from rona_core.errors import NotFoundError
from rona_core.session.captures import PointerCapture, ToolCapture
from rona_core.session.document import Session


@dataclass(frozen=True, slots=True)
class ExportedFile:
    """A file to be saved under its name."""

    name: str
    data: bytes


def recorded_captures(session: Session) -> tuple[tuple[int, str], ...]:
    """Return ordinal and words of every capture that holds a stream of the tracker."""
    held = session.captures
    in_use = {
        id(capture): words
        for words, captures in (
            ("tool", (held.tool,)),
            ("pointer", (held.pointer,)),
            ("surface", held.surface),
            ("path", (held.path,)),
        )
        for capture in captures
    }
    streams = [c for c in session.archive if isinstance(c, ToolCapture | PointerCapture)]
    return tuple(
        (c.ordinal, f"{c.ordinal}: {in_use.get(id(c), 'earlier')}, {_tool(c)}") for c in streams
    )


def _tool(capture: ToolCapture | PointerCapture) -> str:
    return TOOL_TITLES.get(capture.marker.tool, capture.marker.tool)


def export_recording(session: Session, ordinal: int) -> ExportedFile:
    """Return what the tracker saw in one capture as a sequence file (``.igs.mha``).

    Raises:
        NotFoundError: no such capture, or one without a stream of the tracker.
        InvalidInputError: the tool was seen in no frame.
    """
    capture = next((c for c in session.archive if c.ordinal == ordinal), None)
    if not isinstance(capture, ToolCapture | PointerCapture):
        known = ", ".join(str(number) for number, _ in recorded_captures(session)) or "none"
        what = "there is no capture" if capture is None else "no stream of the tracker in capture"
        raise NotFoundError(f"{what} {ordinal}; captures with one are {known}")
    data = write_igs_mha(Recording.from_track(capture.marker))
    plain = "".join(c if c.isalnum() or c in "-_" else "_" for c in session.name)
    return ExportedFile(f"{plain}_{ordinal}_{capture.marker.tool}{SUFFIX}", data)
