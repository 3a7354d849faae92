"""The sessions folder: which open session a file belongs to, its name; captures as files."""

import re
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rona_core.devices.files.poses.sequences import SUFFIX as IGS_SUFFIX
from rona_core.devices.files.poses.sequences import write_igs_mha
from rona_core.devices.recording import Recording
from rona_core.devices.settings import TOOL_TITLES, hidden_characters
from rona_core.errors import FileChangedError, InvalidInputError, NameTakenError, NotFoundError
from rona_core.session.captures import PointerCapture, ToolCapture
from rona_core.session.document import Session
from rona_core.session.files import (
    SUFFIX,
    FileIdentity,
    Stamp,
    alone_in,
    digest_of,
    move_whole,
    remove_stale_temporaries,
    session_bytes,
    stamp_of,
    write_whole,
)

MAX_NAME_BYTES = 200  # file systems take 255; temporary and backup files add to a name
MAX_UPLOAD_BYTES = 512 * 1024**2
FileState = Literal["none", "same", "changed", "missing"]  # beside what was opened or saved


PLAIN_NAME = r"^(?!\.)[^/\\\x00-\x1f\x7f]+$"
FILE_NAME = {  # of a field that names a file; the bytes are counted by ``plain_name``
    "minLength": 1,
    "maxLength": MAX_NAME_BYTES,
    "pattern": PLAIN_NAME,
    "rule": f"a plain file name of at most {MAX_NAME_BYTES} bytes, without path",
}


def plain_name(name: str) -> str:
    """Return ``name`` if it is a plain file name.

    Raises:
        InvalidInputError: empty, hidden, too long, or with a path or a hidden character in it.
    """
    if not re.fullmatch(PLAIN_NAME, name) or hidden_characters(name):
        raise InvalidInputError(f"expected a plain file name, got {name[:60]!a}")
    if len(name.encode()) > MAX_NAME_BYTES:
        raise InvalidInputError(
            f"a file name may have {MAX_NAME_BYTES} bytes, not {len(name.encode())}: shorten it"
        )
    return name


def stem_of(title: str) -> str:
    """Return a plain file name without suffix that resembles ``title``."""
    kept = "".join(c if c.isalnum() or c in "-_ " else "_" for c in title)
    return kept.encode()[: MAX_NAME_BYTES - 20].decode(errors="ignore").strip() or "untitled"


@dataclass(slots=True)
class _Own:
    """The file of an open session as it was when that was opened from it or saved in it."""

    path: Path
    revision: int  # of the session, that is in it
    digest: str
    stamp: Stamp | None  # with which the file was looked at last
    state: FileState = "same"  # as it was then

    def look(self, *, afresh: bool = False) -> FileState:
        """Return how the file stands; it is read only if its stamp has changed, or ``afresh``."""
        stamp = stamp_of(self.path)
        if afresh or stamp != self.stamp:
            self.stamp = stamp
            try:
                same = digest_of(self.path.read_bytes()) == self.digest
                self.state = "same" if same else "changed"
            except OSError:
                self.state = "changed" if self.path.exists() else "missing"
        return self.state


class SessionFiles:
    """The files of the open sessions. A file belongs to one of them at most.

    Other programs write in the same folder: what a file was is compared before it is written over.
    """

    def __init__(self, folder: Path) -> None:
        """Keep sessions in ``folder``; what killed programs left half written there goes."""
        self.folder = folder
        self.uploads = folder / ".uploads"
        self._lock = threading.RLock()  # one name is looked at and taken at a time
        self._own: dict[str, _Own] = {}
        for place in (folder, self.uploads):
            remove_stale_temporaries(place)

    def all(self) -> tuple[Path, ...]:
        """Return the session files in the folder."""
        return tuple(sorted(self.folder.glob(f"*{SUFFIX}")))

    def file(self, session_id: str) -> Path | None:
        """Return the file that a session was loaded from or saved to last."""
        own = self._own.get(session_id)
        return None if own is None else own.path

    def state(self, session_id: str) -> FileState:
        """Return how the file of a session stands beside what was opened or saved."""
        own = self._own.get(session_id)
        return "none" if own is None else own.look()

    def saved(self, session_id: str) -> int | None:
        """Return the revision of a session that is in its file, if that is still what it was."""
        own = self._own.get(session_id)
        return None if own is None or own.look() != "same" else own.revision

    def opened(
        self, session: Session, path: Path, identity: FileIdentity, instead_of: str | None = None
    ) -> bool:
        """Take note where a session comes from; False if that is the file of another open one.

        Args:
            session: The session as it was read.
            path: Its file.
            identity: What the file was then.
            instead_of: Id of an open session that gives this file up.
        """
        with self._lock:
            owner = self._owner(path)
            if owner is not None:
                if owner != instead_of:
                    return False
                del self._own[owner]
            own = _Own(path, len(session.log), identity.digest, identity.stamp)
            self._own[session.id] = own
            return True

    def closed(self, session_id: str) -> None:
        """Forget a session; its file stays."""
        with self._lock:
            self._own.pop(session_id, None)

    def save(self, session: Session, file: str | None, *, replace: bool) -> tuple[Path, str | None]:
        """Write a session to its file, or to that of a plain name; see `SessionRegistry.save`.

        Returns:
            The file, and the open session whose file it was, if it was another one's.
        """
        data = session_bytes(session)
        with self._lock, alone_in(self.folder):
            own = self._own.get(session.id)
            path = self.free_path(session.name) if own is None else own.path
            if file is not None:
                name = plain_name(file)
                path = self.folder / (name if name.endswith(SUFFIX) else name + SUFFIX)
            if path.is_dir():
                raise InvalidInputError(f"{path.name} is a folder: save under another name")
            owner = self._owner(path)
            if own is not None and path == own.path:
                if own.look(afresh=True) == "changed" and not replace:
                    raise FileChangedError(
                        f"{path.name} was changed by another program since it was opened or saved "
                        "here: save under another name, reload it, or say that it is to be replaced"
                    )
            elif not replace:
                _require_free(path, owner)
            write_whole(path, data, backup=True)
            other = None if owner == session.id else owner
            if other is not None:
                self.closed(other)  # its file holds another session now
            self._own[session.id] = _Own(path, len(session.log), digest_of(data), stamp_of(path))
            return path, other

    def _owner(self, path: Path) -> str | None:
        return next((key for key, own in self._own.items() if own.path == path), None)

    def free_path(self, name: str) -> Path:
        """Return an unused path in the folder, after the name of a session."""
        stem = stem_of(name)
        path, number = self.folder / f"{stem}{SUFFIX}", 2
        while path.exists():
            path, number = self.folder / f"{stem} {number}{SUFFIX}", number + 1
        return path

    def store_upload(self, name: str, data: bytes) -> Path:
        """Keep an uploaded file for ``StartSkullImport``; one of that name is replaced."""
        if len(data) > MAX_UPLOAD_BYTES:
            raise InvalidInputError(f"{name} has {len(data) / 1e6:.0f} MB, too large")
        return write_whole(self._upload_path(name), data)

    def keep_upload(self, name: str, body: Path) -> Path:
        """Keep an uploaded file that lies at ``body``, in the same folder, under its plain name."""
        return move_whole(body, self._upload_path(name))

    def _upload_path(self, name: str) -> Path:
        path = self.uploads / plain_name(name)
        if path.is_dir():
            raise InvalidInputError(f"{name} is a folder: upload under another name")
        return path


def _require_free(path: Path, owner: str | None) -> None:
    if owner is not None or path.exists():
        what = "is the file of another open session" if owner is not None else "exists already"
        raise NameTakenError(
            f"{path.name} {what}: choose another name, or say that it is to be replaced"
        )


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
    return ExportedFile(f"{plain}_{ordinal}_{capture.marker.tool}{IGS_SUFFIX}", data)
