"""All open sessions: made, opened from files, saved, closed; one of them is the current one."""

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rona_core.app.autosave import Autosave, CopyState
from rona_core.app.names import plain_name, stem_of
from rona_core.app.workbench import Services, Workbench
from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.session.document import Session, Setup
from rona_core.session.files import (
    SUFFIX,
    load_session,
    move_whole,
    save_session,
    session_from_bytes,
    write_whole,
)

CURRENT = "current"  # alias for the session that the viewer shows
MAX_OPEN = 16
MAX_UPLOAD_BYTES = 512 * 1024**2


class Hub:
    """Opens and closes workbenches. Safe to use from several threads."""

    def __init__(
        self, services: Services, folder: Path, on_close: Callable[[], None] = lambda: None
    ) -> None:
        self.folder = folder
        self._on_close = on_close
        self.uploads = folder / ".uploads"
        self._autosave = Autosave(folder, on_change=self._tell)
        self._services = services
        self._lock = threading.RLock()
        self._open: dict[str, Workbench] = {}
        self._files: dict[str, Path] = {}
        self._saved: dict[str, int] = {}  # revision that is in the file
        self._current: str | None = None
        self._listeners: list[Callable[[], None]] = []

    # -------------------------------------------------------------- asking

    def ids(self) -> tuple[str, ...]:
        """Return the ids of the open sessions, oldest first."""
        with self._lock:
            return tuple(self._open)

    def get(self, session_id: str = CURRENT) -> Workbench:
        """Return the workbench of an open session.

        Raises:
            NotFoundError: it is not open.
        """
        with self._lock:
            wanted = self._current if session_id == CURRENT else session_id
            if wanted is None or wanted not in self._open:
                known = ", ".join(self._open) or "none"
                raise NotFoundError(f"there is no open session {session_id!r} (open: {known})")
            return self._open[wanted]

    def is_current(self, session_id: str) -> bool:
        """Return whether this is the session that the viewer shows."""
        return session_id == self._current

    def file(self, session_id: str) -> Path | None:
        """Return the file that a session was loaded from or saved to last."""
        return self._files.get(self.get(session_id).session.id)

    def is_saved(self, session_id: str) -> bool:
        """Return whether the file holds the session as it is now."""
        bench = self.get(session_id)
        return self._saved.get(bench.session.id) == bench.store.revision

    def copy_state(self, session_id: str) -> CopyState:
        """Return whether a copy is kept of what is not saved."""
        return self._autosave.state(self.get(session_id).session.id)

    def files(self) -> tuple[Path, ...]:
        """Return the session files in the sessions folder."""
        return tuple(sorted(self.folder.glob(f"*{SUFFIX}")))

    # -------------------------------------------------------------- opening and closing

    def create(self, name: str = "untitled", seed: int = 0) -> Workbench:
        """Open a new, empty session and make it the current one."""
        return self._add(Session(name=name, setup=Setup(seed=seed)))

    def open_file(self, file: str) -> Workbench:
        """Open a file of the sessions folder by its plain name.

        Raises:
            NotFoundError: no such file.
            SessionFormatError: it is damaged, foreign or newer; what is open stays as it was.
        """
        path = self.folder / plain_name(file)
        return self._add(load_session(path), path)

    def open_bytes(self, data: bytes, name: str) -> Workbench:
        """Open the contents of an uploaded session file; errors as in ``open_file``."""
        return self._add(session_from_bytes(data, name))

    def open_upload(self, path: Path, name: str) -> Workbench:
        """Open an uploaded session file that lies at ``path``; errors as in ``open_file``."""
        return self._add(load_session(path, name))

    def open_session(self, session: Session) -> Workbench:
        """Open a session that was made in Python."""
        return self._add(session)

    def _add(self, session: Session, path: Path | None = None) -> Workbench:
        with self._lock:
            if session.id in self._open:  # a second copy of an open session is another session
                session = replace(session, id=Session().id)
            if len(self._open) >= MAX_OPEN:
                raise InvalidInputError(f"{MAX_OPEN} sessions are open: close one first")
            bench = Workbench(session, self._services, self.uploads, self._autosave.keep)
            self._open[session.id] = bench
            self._autosave.watch(bench.store)
            if path is not None:
                self._files[session.id] = path
                self._saved[session.id] = bench.store.revision
            self._current = session.id
        self._tell()
        return bench

    def make_current(self, session_id: str) -> Workbench:
        """Show another open session in the viewer."""
        with self._lock:
            bench = self.get(session_id)
            self._current = bench.session.id
        self._tell()
        return bench

    def close(self, session_id: str) -> None:
        """Close a session; what was not saved is gone. Its file stays."""
        key = self.get(session_id).session.id
        self._close(key)
        self._autosave.forget(key)

    def _close(self, session_id: str) -> None:
        with self._lock:
            bench = self.get(session_id)
            key = bench.session.id
            del self._open[key]
            self._files.pop(key, None)
            self._saved.pop(key, None)
            if self._current == key:
                self._current = next(reversed(self._open), None)
        bench.close()
        self._tell()

    def close_all(self) -> None:
        """Close every session, at the end of the program; copies of what is not saved stay."""
        self._autosave.close()
        for session_id in self.ids():
            self._close(session_id)
        self._on_close()

    # -------------------------------------------------------------- saving

    def save(self, session_id: str = CURRENT, file: str | None = None) -> Path:
        """Write a session to the sessions folder and return the file.

        Without a file name it goes where it came from, or under its own name.
        """
        bench = self.get(session_id)
        session, revision = bench.session, bench.store.revision
        path = self._files.get(session.id)
        if file is not None:
            name = plain_name(file)
            path = self.folder / (name if name.endswith(SUFFIX) else name + SUFFIX)
        if path is None:
            path = self._free_path(session.name)
        if path.is_dir():
            raise InvalidInputError(f"{path.name} is a folder: save under another name")
        save_session(session, path)
        with self._lock:
            self._files[session.id] = path
            self._saved[session.id] = revision
        self._autosave.saved(session)
        self._tell()
        return path

    def _free_path(self, name: str) -> Path:
        stem = stem_of(name)
        path, number = self.folder / f"{stem}{SUFFIX}", 2
        while path.exists():
            path, number = self.folder / f"{stem} {number}{SUFFIX}", number + 1
        return path

    def store_upload(self, name: str, data: bytes) -> Path:
        """Keep an uploaded file for ``StartSkullImport``; one of that name is replaced."""
        if len(data) > MAX_UPLOAD_BYTES:
            raise InvalidInputError(f"{name} has {len(data) / 1e6:.0f} MB, too large")
        path = self.uploads / plain_name(name)
        if path.is_dir():
            raise InvalidInputError(f"{name} is a folder: upload under another name")
        return write_whole(path, data)

    def keep_upload(self, name: str, body: Path) -> Path:
        """Keep an uploaded file that lies at ``body``, in the same folder, under its plain name."""
        path = self.uploads / plain_name(name)
        if path.is_dir():
            raise InvalidInputError(f"{name} is a folder: upload under another name")
        return move_whole(body, path)

    # -------------------------------------------------------------- telling

    def subscribe(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call ``listener()`` when sessions are opened, closed, saved or another is shown."""
        with self._lock:
            self._listeners.append(listener)

        def unsubscribe() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return unsubscribe

    def _tell(self) -> None:
        with self._lock:
            listeners = tuple(self._listeners)
        for listener in listeners:
            listener()
