"""Sessions kept against a crash: the folder of a running program, and what it left behind."""

import contextlib
import os
import sys
import threading
import uuid
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import step_states
from rona_core.app.runtime.saving.journal import (
    JOURNAL_SUFFIX,
    Reach,
    append_entries,
    begin_journal,
    read_journal,
    remove_journal,
    restore,
)
from rona_core.app.runtime.store import Store
from rona_core.errors import NotFoundError, RonaError
from rona_core.session.document import Session
from rona_core.session.files import lock_file, remove_stale_temporaries, sync_folder

LOCK = "lock"


class RunFolder:
    """A folder of this program alone below ``root``, made when it is first needed.

    The lock in it ends with the process, so that it need not be guessed from the number of a
    process whether that one still runs.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self.path = root / uuid.uuid4().hex[:12]
        self._descriptor: int | None = None

    def claim(self) -> Path:
        """Return the folder, locked; a second call finds it as it is, or makes it anew.

        Raises:
            OSError: no room, or no right to write.
        """
        if self._descriptor is not None and not (self.path / LOCK).exists():
            os.close(self._descriptor)  # it was cleared away meanwhile
            self._descriptor = None
        if self._descriptor is None:
            self._root.mkdir(parents=True, exist_ok=True)
            with _alone(self._root):  # else it might be taken for a dead one before it is locked
                self.path.mkdir(exist_ok=True)
                descriptor = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
                lock_file(descriptor)
                self._descriptor = descriptor
            for folder in (self._root, self._root.parent):  # it outlives the machine too
                sync_folder(folder)
        return self.path

    def release(self) -> None:
        """Let go of the folder, which goes if nothing is in it; a second call does nothing."""
        if self._descriptor is not None:
            with contextlib.suppress(OSError):
                remove_if_empty(self.path)
            os.close(self._descriptor)
            self._descriptor = None


def dead_folders(root: Path) -> tuple[Path, ...]:
    """Return the folders below ``root`` whose program does not run any more.

    Raises:
        OSError: no right to look.
    """
    if not root.is_dir():
        return ()
    with _alone(root):
        return tuple(sorted(f for f in root.iterdir() if f.is_dir() and _is_dead(f)))


def _is_dead(folder: Path) -> bool:
    with _hold(folder) as held:
        return held


@contextlib.contextmanager
def hold(folder: Path) -> Generator[bool, None, None]:
    """Hold a folder whose program has ended; yields False where that or another one has it."""
    with contextlib.ExitStack() as held:
        with _alone(folder.parent):  # else a look whether it is dead may be in the way
            taken = held.enter_context(_hold(folder))
        yield taken


@contextlib.contextmanager
def _hold(folder: Path) -> Generator[bool, None, None]:
    try:
        descriptor = os.open(folder / LOCK, os.O_RDWR)
    except FileNotFoundError:
        yield folder.is_dir()  # of a time without locks
        return
    try:
        yield lock_file(descriptor)
    finally:
        os.close(descriptor)


def remove_if_empty(folder: Path) -> None:
    """Remove a folder with nothing but its lock in it."""
    if {path.name for path in folder.iterdir()} <= {LOCK}:
        (folder / LOCK).unlink(missing_ok=True)
        folder.rmdir()


@contextlib.contextmanager
def _alone(root: Path) -> Generator[None, None, None]:
    """Be the only program that makes or judges folders below ``root``, for a moment."""
    descriptor = os.open(root / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        lock_file(descriptor, wait=True)
        yield
    finally:
        os.close(descriptor)


RETRY_S = 20.0  # after a journal that could not be written
FOLDER = ".autosave"
CopyState = Literal["none", "kept", "failed"]  # failed: no space, or no right to write


@dataclass(slots=True)
class _Watched:
    store: Store
    written: int  # revision that is in the journal, or in the file of the session
    reach: Reach | None = None  # of the journal; None where there is none
    failed: bool = False  # the last time it was tried
    retry: threading.Timer | None = None
    writing: threading.Lock = field(default_factory=threading.Lock)  # one at a time


class Autosave:
    """Writes down what is changed in a session, before the change counts as done.

    A journal begins with a copy of the whole session; a command adds a row to it. Where that does
    not suffice (what a device measured, a step taken back from before the copy, a long journal)
    it is begun anew. Journals lie in a folder of this program alone below ``folder``, named by
    the id of the session. They go when the session is saved or closed, and stay when the program
    ends without either.
    """

    def __init__(self, folder: Path, on_change: Callable[[], None]) -> None:
        """Keep journals under ``folder``; ``on_change()`` is called when a state has changed."""
        self._folder = RunFolder(folder / FOLDER)
        self._on_change = on_change
        self._watched: dict[str, _Watched] = {}

    @property
    def run(self) -> str:
        """Name of the folder of this program, which no other one has."""
        return self._folder.path.name

    def file(self, session_id: str) -> Path:
        """Return where the journal of a session is while there is one."""
        return self._folder.path / f"{session_id}{JOURNAL_SUFFIX}"

    def state(self, session_id: str) -> CopyState:
        """Return how the journal of a session stands."""
        watched = self._watched.get(session_id)
        if watched is not None and watched.failed:
            return "failed"
        return "kept" if watched is not None and watched.reach is not None else "none"

    def watch(self, store: Store, *, changed: bool = False) -> None:
        """Take charge of a session; ``changed`` where no file holds it as it is."""
        self._watched[store.session.id] = _Watched(store, -1 if changed else store.revision)

    def keep(self, session: Session) -> None:
        """Write down what is not yet; a failure is remembered, shown and not raised.

        After a failure it is not tried at every change, which would hold each of them up.
        """
        watched = self._watched.get(session.id)
        if watched is not None and not watched.failed:
            self._keep(watched, session)

    def _keep(self, watched: _Watched, session: Session) -> None:
        with watched.writing:
            if watched.written >= len(session.log):
                return
            before = watched.reach is not None, watched.failed
            try:
                self._write(watched, session)
            except Exception as error:  # no space, no right to write: work goes on without it
                if not watched.failed:
                    sys.stderr.write(f"no copy of session {session.id} is kept: {error}\n")
                watched.failed, watched.reach = True, None
                watched.retry = threading.Timer(RETRY_S, self._try_again, (watched,))
                watched.retry.daemon = True
                watched.retry.start()
            after = watched.reach is not None, watched.failed
        if before != after:
            self._on_change()

    def _try_again(self, watched: _Watched) -> None:
        if self._watched.get(watched.store.session.id) is watched:  # else it is closed
            self._keep(watched, watched.store.session)

    def _write(self, watched: _Watched, session: Session) -> None:
        """Add rows to the journal where that suffices, else begin it anew."""
        entries = session.log[max(watched.written, 0) :]
        path = self.file(session.id)
        longer = None if watched.reach is None else watched.reach.after(entries)
        if longer is not None and path.exists():  # it has not been cleared away
            append_entries(path, entries)
        else:
            self._folder.claim()
            begin_journal(path, session)
            longer = Reach()
        watched.reach, watched.written, watched.failed = longer, len(session.log), False

    def saved(self, session: Session) -> None:
        """Take note that ``session`` is in its file: its journal is not needed any more."""
        watched = self._watched.get(session.id)
        if watched is None:
            return
        with watched.writing:
            if watched.written <= len(session.log):
                watched.written, watched.reach, watched.failed = len(session.log), None, False
                self._remove(session.id)

    def unsaved(self, session_id: str) -> None:
        """Take note that no file holds a session any more: a journal is needed, now."""
        watched = self._watched.get(session_id)
        if watched is not None:
            with watched.writing:
                watched.written, watched.reach = -1, None
            self.keep(watched.store.session)

    def forget(self, session_id: str) -> None:
        """Drop a session and its journal: it was closed on purpose."""
        watched = self._drop(session_id)
        if watched is not None:
            with watched.writing:  # what is being written is removed afterwards
                watched.written = sys.maxsize
                self._remove(session_id)

    def _remove(self, session_id: str) -> None:
        with contextlib.suppress(OSError):  # a journal too many does no harm
            remove_journal(self.file(session_id))

    def close(self) -> None:
        """Write what is not written yet, and end; a second call does nothing."""
        for key in tuple(self._watched):
            watched = self._watched[key]
            self._keep(watched, watched.store.session)
            self._drop(key)
        self._folder.release()

    def _drop(self, key: str) -> _Watched | None:
        watched = self._watched.pop(key, None)
        if watched is not None and watched.retry is not None:
            watched.retry.cancel()
        return watched


@dataclass(frozen=True, slots=True)
class LostSession:
    """A session that was not saved when its program ended, as described by its copy."""

    key: str  # by which it is recovered or discarded
    name: str | None  # None where the copy cannot be read
    changed_utc: str  # when something was written to the copy last
    revision: int  # how many messages had changed it
    steps_done: tuple[str, ...]
    steps_stale: tuple[str, ...]
    size_bytes: int
    problem: str | None = None  # what cannot be read or done again


@dataclass(frozen=True, slots=True)
class LostCopy:
    """The journal of one such session."""

    key: str
    path: Path

    def remove(self) -> None:
        """Remove it, and its folder if it was the last."""
        remove_journal(self.path)
        _drop_folder(self.path.parent)


class Recovery:
    """Knows the copies below a sessions folder whose program does not run any more."""

    def __init__(self, folder: Path) -> None:
        self._root = folder / FOLDER
        self._known: dict[Path, tuple[object, LostSession]] = {}
        self._lock = threading.Lock()
        self._held: Path | None = None  # the folder of what is being recovered or discarded

    def tidy(self) -> int:
        """Remove what was left half written, and folders without a copy; return how many files."""
        if not self._root.is_dir():
            return 0
        count = 0
        for folder in dead_folders(self._root):
            with hold(folder) as held:
                if held:
                    count += remove_stale_temporaries(folder)
                    _drop_folder(folder)
        return count

    def keys(self) -> tuple[str, ...]:
        """Return the keys of all that can be recovered, without reading it."""
        return tuple(copy.key for copy in self._copies())

    def all(self) -> tuple[LostSession, ...]:
        """Return all that can be recovered, the newest first; what cannot be read says so."""
        found: dict[Path, tuple[object, LostSession]] = {}
        for copy in self._copies():
            with contextlib.suppress(FileNotFoundError):  # it was recovered meanwhile
                file = copy.path.stat()
                stamp = file.st_mtime_ns, file.st_size
                known = self._known.get(copy.path)
                if known is None or known[0] != stamp:
                    known = stamp, _describe(copy)
                found[copy.path] = known
        self._known = found
        lost = (session for _, session in found.values())
        return tuple(sorted(lost, key=lambda s: (s.changed_utc, s.key), reverse=True))

    @contextlib.contextmanager
    def held(self, key: str) -> Generator[LostCopy, None, None]:
        """Hold a journal, so that neither another program nor another thread takes it meanwhile.

        Raises:
            NotFoundError: there is none of that key, or another program has taken it.
        """
        with self._lock:
            copy = next((copy for copy in self._copies() if copy.key == key), None)
            if copy is not None:
                try:
                    with hold(copy.path.parent) as held:
                        self._held = copy.path.parent if held else None
                        if held and copy.path.is_file():
                            yield copy
                            return
                finally:
                    self._held = None
        raise NotFoundError(f"there is no unsaved session {key!r} to recover: look at the list")

    def discard(self, key: str) -> None:
        """Remove a journal for good; errors as in `held`."""
        with self.held(key) as copy:
            copy.remove()

    def _copies(self) -> list[LostCopy]:
        held = self._held  # by this program, so that its lock is not free
        folders = {*dead_folders(self._root), *(() if held is None else (held,))}
        files = [p for f in folders for p in f.glob(f"*{JOURNAL_SUFFIX}")]
        found = [LostCopy(f"{path.parent.name}-{path.stem}", path) for path in files]
        return sorted(found, key=lambda copy: copy.key)


def _drop_folder(folder: Path) -> None:
    with contextlib.suppress(OSError):  # an empty folder too many does no harm
        remove_if_empty(folder)


def _describe(copy: LostCopy) -> LostSession:
    file = copy.path.stat()
    when = datetime.fromtimestamp(file.st_mtime, UTC).isoformat(timespec="seconds")
    size = file.st_size
    try:
        journal = read_journal(copy.path)
        store = Store(journal.session)
        problem = restore(store, journal)
    except Exception as error:  # whatever is wrong with it: it is shown, and stays
        text = str(error) if isinstance(error, RonaError) else f"it cannot be read: {error}"
        return LostSession(copy.key, None, when, 0, (), (), size, text)
    states = {step.name: step.state for step in step_states(store.session)}
    done, stale = (
        tuple(n for n in REGISTRY.step_names if states[n] == s) for s in ("done", "stale")
    )
    name, revision = store.session.name, store.revision
    return LostSession(copy.key, name, when, revision, done, stale, size, problem)
