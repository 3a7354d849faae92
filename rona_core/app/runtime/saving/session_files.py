"""The sessions folder: which open session a file belongs to, and under which name one is saved."""

import re
import threading
from pathlib import Path

from rona_core.errors import InvalidInputError, NameTakenError
from rona_core.session.document import Session
from rona_core.session.files import (
    SUFFIX,
    move_whole,
    remove_stale_temporaries,
    save_session,
    write_whole,
)

MAX_NAME_BYTES = 200  # file systems take 255; temporary and backup files add to a name
MAX_UPLOAD_BYTES = 512 * 1024**2


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
        InvalidInputError: empty, hidden, too long, or with a path or a control character in it.
    """
    if not re.fullmatch(PLAIN_NAME, name):
        raise InvalidInputError(f"expected a plain file name, got {name[:60]!r}")
    if len(name.encode()) > MAX_NAME_BYTES:
        raise InvalidInputError(
            f"a file name may have {MAX_NAME_BYTES} bytes, not {len(name.encode())}: shorten it"
        )
    return name


def stem_of(title: str) -> str:
    """Return a plain file name without suffix that resembles ``title``."""
    kept = "".join(c if c.isalnum() or c in "-_ " else "_" for c in title)
    return kept.encode()[: MAX_NAME_BYTES - 20].decode(errors="ignore").strip() or "untitled"


class SessionFiles:
    """Knows the files of the open sessions. A file belongs to one of them at most."""

    def __init__(self, folder: Path) -> None:
        """Keep sessions in ``folder``; what killed programs left half written there goes."""
        self.folder = folder
        self.uploads = folder / ".uploads"
        self._lock = threading.RLock()  # one name is looked at and taken at a time
        self._files: dict[str, Path] = {}
        self._saved: dict[str, int] = {}  # revision that is in the file
        for place in (folder, self.uploads):
            remove_stale_temporaries(place)

    def all(self) -> tuple[Path, ...]:
        """Return the session files in the folder."""
        return tuple(sorted(self.folder.glob(f"*{SUFFIX}")))

    def file(self, session_id: str) -> Path | None:
        """Return the file that a session was loaded from or saved to last."""
        return self._files.get(session_id)

    def saved(self, session_id: str) -> int | None:
        """Return the revision of a session that is in its file."""
        return self._saved.get(session_id)

    def opened(self, session: Session, path: Path) -> bool:
        """Take note where a session comes from; False if that is the file of another open one."""
        with self._lock:
            if self._owner(path) is not None:
                return False
            self._files[session.id], self._saved[session.id] = path, len(session.log)
            return True

    def closed(self, session_id: str) -> None:
        """Forget a session; its file stays."""
        with self._lock:
            self._files.pop(session_id, None)
            self._saved.pop(session_id, None)

    def save(self, session: Session, file: str | None, *, replace: bool) -> tuple[Path, str | None]:
        """Write a session to its file, or to that of a plain name; see `SessionRegistry.save`.

        Returns:
            The file, and the open session whose file it was, if it was another one's.
        """
        with self._lock:
            own = self._files.get(session.id)
            path = own or self.free_path(session.name)
            if file is not None:
                name = plain_name(file)
                path = self.folder / (name if name.endswith(SUFFIX) else name + SUFFIX)
            if path.is_dir():
                raise InvalidInputError(f"{path.name} is a folder: save under another name")
            owner = self._owner(path)
            if path != own and not replace:
                _require_free(path, owner)
            save_session(session, path)
            other = None if owner == session.id else owner
            if other is not None:
                self.closed(other)  # its file holds another session now
            self._files[session.id], self._saved[session.id] = path, len(session.log)
            return path, other

    def _owner(self, path: Path) -> str | None:
        return next((key for key, file in self._files.items() if file == path), None)

    def free_path(self, name: str) -> Path:
        """Return a path in the folder that nobody uses, after the name of a session."""
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
