"""All open sessions: made, opened from files, saved, closed; one of them is the current one."""

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from rona_core.app.runtime.saving.autosave import Autosave, CopyState, LostSession, Recovery
from rona_core.app.runtime.saving.journal import read_journal, restore
from rona_core.app.runtime.saving.session_files import FileState, SessionFiles, plain_name
from rona_core.app.runtime.workbench import Services, Workbench
from rona_core.devices.limits import require
from rona_core.devices.settings import hidden_characters
from rona_core.errors import FileChangedError, InvalidInputError, NotFoundError
from rona_core.session.document import Session, Setup
from rona_core.session.files import FileIdentity, backup_of, load_identified, load_session

CURRENT = "current"  # alias for the session that the viewer shows
MAX_OPEN = 16
ENDING_S = 1.5  # that the end of the program waits for jobs, all together


@dataclass(frozen=True, slots=True)
class _Origin:
    """The file of the sessions folder that a session was read from, as it was then."""

    path: Path
    identity: FileIdentity


def _identified(path: Path) -> tuple[Session, _Origin]:
    session, identity = load_identified(path)
    return session, _Origin(path, identity)


class SessionRegistry:
    """Opens and closes workbenches. Safe to use from several threads."""

    def __init__(
        self, services: Services, folder: Path, on_close: Callable[[], None] = lambda: None
    ) -> None:
        self._on_close = on_close
        self.files = SessionFiles(folder)
        self._autosave = Autosave(folder, on_change=self._tell)
        self._recovery = Recovery(folder)
        self._services = services
        self._lock = threading.RLock()
        self._open: dict[str, Workbench] = {}
        self._begun: dict[str, int] = {}  # revision at which what has no file was opened
        self._recovered: set[str] = set()  # and not saved since
        self._unfiled: set[str] = set()  # whose file another program has changed or removed
        self._current: str | None = None
        self._listeners: list[Callable[[], None]] = []
        with suppress(OSError):  # then the list of them reports it
            self._recovery.tidy()

    @property
    def run(self) -> str:
        """Name of this run of the program, another one after each start."""
        return self._autosave.run

    # -------------------------------------------------------------- asking

    def ids(self) -> tuple[str, ...]:
        """Return the ids of the open sessions, oldest first."""
        with self._lock:
            return tuple(self._open)

    def all(self) -> tuple[Workbench, ...]:
        """Return the workbenches of the open sessions, oldest first."""
        with self._lock:
            return tuple(self._open.values())

    def get(self, session_id: str = CURRENT) -> Workbench:
        """Return the workbench of an open session.

        It waits for no lock: Stop asks here while another session may be opened.

        Raises:
            NotFoundError: it is not open.
        """
        wanted = self._current if session_id == CURRENT else session_id
        found = None if wanted is None else self._open.get(wanted)
        if found is None:
            known = ", ".join(tuple(self._open)) or "none"
            raise NotFoundError(f"there is no open session {session_id!r} (open: {known})")
        return found

    def is_current(self, session_id: str) -> bool:
        """Return whether this is the session that the viewer shows."""
        return session_id == self._current

    def file(self, session_id: str) -> Path | None:
        """Return the file that a session was loaded from or saved to last."""
        return self.files.file(self.get(session_id).session.id)

    def is_saved(self, session_id: str) -> bool:
        """Return whether the file holds the session as it is now.

        Where another program has changed or removed the file, a copy of the session is kept.
        """
        bench = self.get(session_id)
        key = bench.session.id
        if self.files.state(key) in ("changed", "missing") and key not in self._unfiled:
            self._unfiled.add(key)
            self._autosave.unsaved(key)
        return self.files.saved(key) == bench.store.revision

    def file_state(self, session_id: str) -> FileState:
        """Return how the file of a session stands beside what was opened or saved."""
        return self.files.state(self.get(session_id).session.id)

    def has_changes(self, session_id: str) -> bool:
        """Return whether something would be lost if the session were closed as it is now."""
        bench = self.get(session_id)
        unchanged = self._begun.get(bench.session.id) == bench.store.revision
        return not self.is_saved(session_id) and not unchanged

    def is_recovered(self, session_id: str) -> bool:
        """Return whether the session was recovered and has not been saved since."""
        return self.get(session_id).session.id in self._recovered

    def copy_state(self, session_id: str) -> CopyState:
        """Return whether a copy is kept of what is not saved."""
        return self._autosave.state(self.get(session_id).session.id)

    # -------------------------------------------------------------- opening and closing

    def create(self, name: str = "untitled", seed: int = 0) -> Workbench:
        """Open a new, empty session and make it the current one.

        Raises:
            InvalidInputError: the name has hidden characters in it.
        """
        require(not hidden_characters(name), f"hidden characters in the name {name[:60]!a}")
        return self._add(Session(name=name, setup=Setup(seed=seed)))

    def open_file(self, file: str) -> Workbench:
        """Open a file of the sessions folder by its plain name.

        Raises:
            NotFoundError: no such file.
            SessionFormatError: it is damaged, foreign or newer; what is open stays as it was.
        """
        path = self.files.folder / plain_name(file)
        return self._add(*_identified(path))

    def open_backup(self, file: str) -> Workbench:
        """Open what a file of the sessions folder replaced, as a copy that is not saved.

        Args:
            file: Plain name of the file that cannot be read.

        Raises:
            NotFoundError: there is no such copy.
            SessionFormatError: it is damaged, too.
        """
        path = backup_of(self.files.folder / plain_name(file))
        return self._add(load_session(path))

    def open_upload(self, path: Path, name: str) -> Workbench:
        """Open an uploaded session file that lies at ``path``; errors as in ``open_file``."""
        return self._add(load_session(path, name))

    def open_path(self, path: Path) -> Workbench:
        """Open a file of the sessions folder, or a copy of any other; errors as in `open_file`."""
        if path.resolve().parent == self.files.folder.resolve():
            return self.open_file(path.name)
        return self.open_upload(path, path.name)

    def open_session(self, session: Session) -> Workbench:
        """Open a session that was made in Python."""
        return self._add(session)

    def reload(self, session_id: str) -> Workbench:
        """Open the file of a session anew, in its place; what is not in the file is gone.

        Raises:
            NotFoundError: it has no file, or that is not there any more.
            SessionFormatError: the file cannot be read. The session stays as it was then.
        """
        key = self.get(session_id).session.id
        path = self.files.file(key)
        if path is None:
            raise NotFoundError("the session has no file to be reloaded: save it first")
        bench = self._add(*_identified(path), instead_of=key)
        self.close(key)
        return bench

    def _add(
        self,
        session: Session,
        origin: _Origin | None = None,
        *,
        recovered: bool = False,
        instead_of: str | None = None,
    ) -> Workbench:
        with self._lock:
            if session.id in self._open:  # a second copy of an open session is another session
                session = replace(session, id=Session().id)
            if len(self._open) - (instead_of in self._open) >= MAX_OPEN:
                raise InvalidInputError(f"{MAX_OPEN} sessions are open: close one first")
            bench = Workbench(session, self._services, self.files.uploads, self._autosave.keep)
            self._open[session.id] = bench
            self._autosave.watch(bench.store, changed=recovered)
            if recovered:
                self._recovered.add(session.id)
            self._current = session.id
        known = origin is not None and self.files.opened(
            session, origin.path, origin.identity, instead_of
        )
        if not recovered and not known:
            self._begun[session.id] = bench.store.revision
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
            self._begun.pop(key, None)
            self._recovered.discard(key)
            self._unfiled.discard(key)
            if self._current == key:
                self._current = next(reversed(self._open), None)
        self.files.closed(key)
        bench.close()
        self._tell()

    def close_all(self) -> None:
        """Close every session, at the end of the program; copies of what is not saved stay.

        What jobs have measured until now is stored and kept first, if they end soon.
        """
        benches = [self.get(session_id) for session_id in self.ids()]
        for bench in benches:
            bench.jobs.cancel_all()
            bench.stop()
        ends_s = time.monotonic() + ENDING_S
        for bench in benches:
            bench.jobs.wait_all(max(0.0, ends_s - time.monotonic()))
        self._autosave.close()
        for session_id in self.ids():
            self._close(session_id)
        self._on_close()

    # -------------------------------------------------------------- recovering

    def lost(self) -> tuple[LostSession, ...]:
        """Return sessions that programs which have ended left unsaved, the newest first."""
        return self._recovery.all()

    def lost_keys(self) -> tuple[str, ...]:
        """Return their keys, without reading them."""
        return self._recovery.keys()

    def recover(self, key: str) -> tuple[Workbench, str | None]:
        """Open such a session and make it the current one; it is not saved yet.

        Returns:
            Its workbench, and what of it could not be recovered; then its copy stays in the list.

        Raises:
            NotFoundError: there is none of that key, or another program has taken it.
            SessionFormatError: its copy cannot be read; it stays where it is.
        """
        with self._recovery.held(key) as copy:
            journal = read_journal(copy.path)
            bench = self._add(journal.session, recovered=True)
            problem = restore(bench.store, journal)
            self._autosave.keep(bench.session)
            if problem is None and self.copy_state(bench.session.id) == "kept":
                copy.remove()
        self._tell()
        return bench, problem

    def discard(self, key: str) -> None:
        """Remove the copy of such a session for good; errors as in ``recover``."""
        self._recovery.discard(key)
        self._tell()

    # -------------------------------------------------------------- saving

    def save(
        self, session_id: str = CURRENT, file: str | None = None, *, replace: bool = False
    ) -> Path:
        """Write a session to the sessions folder and return the file.

        Without a file name it goes where it came from, or under its own name.

        Args:
            session_id: Which session.
            file: Plain name of the file.
            replace: Write over a file of that name that is not this session's, or that another
                program has changed; what was there stays beside it as ``.bak``, and an open
                session that it belonged to has none then.

        Raises:
            NameTakenError: there is such a file, and ``replace`` was not said.
            FileChangedError: another program has changed the file of the session, likewise.
        """
        session = self.get(session_id).session
        try:
            path, other = self.files.save(session, file, replace=replace)
        except FileChangedError:
            self._tell()  # the session is not saved any more
            raise
        self._recovered.discard(session.id)
        self._unfiled.discard(session.id)
        self._begun.pop(session.id, None)
        self._autosave.saved(session)
        if other is not None:
            self._autosave.unsaved(other)
        self._tell()
        return path

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
