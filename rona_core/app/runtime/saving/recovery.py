"""Sessions that a program left behind unsaved when it ended: list them, load one, discard one."""

import contextlib
import re
import threading
import time
from collections.abc import Generator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.step_states import step_states
from rona_core.app.runtime.saving.autosave import FOLDER
from rona_core.app.runtime.saving.journal import (
    JOURNAL_SUFFIX,
    Journal,
    read_journal,
    replay_entries,
)
from rona_core.app.runtime.saving.run_folder import dead_folders, hold, remove_if_empty
from rona_core.app.runtime.store import Store
from rona_core.errors import NotFoundError, RonaError
from rona_core.session.document import Session
from rona_core.session.files import MADE, SUFFIX, load_session, remove_stale_temporaries

OLD_TEMPORARY = re.compile(r"\.[\w-]+\.rona\.[a-z0-9_]{8}")  # before they ended in .part
TRIES, WAIT_S = 20, 0.05  # of holding a folder


@dataclass(frozen=True, slots=True)
class LostSession:
    """A session that was not saved when its program ended, as its copy tells."""

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
    """The files of one such session: the copy, and the journal beside it."""

    key: str
    path: Path

    @property
    def journal(self) -> Path:
        """Where the commands after the copy are, if there are any."""
        return self.path.with_suffix(JOURNAL_SUFFIX)

    def stamp(self) -> tuple[tuple[int, int], ...]:
        """Return what changes when the files do: time and size of each."""
        there = [p.stat() for p in (self.path, self.journal) if p.exists()]
        return tuple((s.st_mtime_ns, s.st_size) for s in there)

    def load(self) -> tuple[Session, Journal]:
        """Return the copy and what its journal adds; errors as in `load_session`."""
        session = load_session(self.path)
        return session, read_journal(self.journal, len(session.log))

    def remove(self) -> None:
        """Remove the files, and their folder if they were the last."""
        self.path.unlink(missing_ok=True)  # first: a journal alone is not offered
        self.journal.unlink(missing_ok=True)
        _drop_folder(self.path.parent)


class Recovery:
    """Knows the copies below a sessions folder whose program does not run any more."""

    def __init__(self, folder: Path) -> None:
        self._root = folder / FOLDER
        self._known: dict[Path, tuple[object, LostSession]] = {}
        self._lock = threading.Lock()
        self._held: dict[Path, tuple[contextlib.ExitStack, int]] = {}  # folders, and how often
        self._taken: set[str] = set()  # keys of the copies that are being recovered or discarded

    def tidy(self) -> int:
        """Remove what was left half written, and folders without a copy; return how many files."""
        if not self._root.is_dir():
            return 0
        count = remove_stale_temporaries(self._root, OLD_TEMPORARY)
        for folder in dead_folders(self._root):
            with hold(folder) as held:
                if held:
                    count += remove_stale_temporaries(folder, MADE)
                    _drop_folder(folder)
        return count

    def keys(self) -> tuple[str, ...]:
        """Return the keys of all that can be recovered, without reading it."""
        return tuple(copy.key for copy in self._copies())

    def all(self) -> tuple[LostSession, ...]:
        """Return all that can be recovered, the newest first; what cannot be read says so."""
        found: dict[Path, tuple[object, LostSession]] = {}
        for copy in self._copies():
            with contextlib.suppress(FileNotFoundError):  # somebody has just recovered it
                stamp = copy.stamp()
                known = self._known.get(copy.path)
                if known is None or known[0] != stamp:
                    known = stamp, _describe(copy)
                found[copy.path] = known
        self._known = found
        lost = (session for _, session in found.values())
        return tuple(sorted(lost, key=lambda s: (s.changed_utc, s.key), reverse=True))

    @contextlib.contextmanager
    def held(self, key: str) -> Generator[LostCopy, None, None]:
        """Hold a copy, so that no other program takes it meanwhile.

        Raises:
            NotFoundError: there is none of that key, or another program has taken it.
        """
        copy = next((copy for copy in self._copies() if copy.key == key), None)
        if copy is not None and self._take(copy):
            try:
                if copy.path.is_file():
                    yield copy
                    return
            finally:
                self._let_go(copy)
        raise NotFoundError(f"there is no unsaved session {key!r} to recover: look at the list")

    def _take(self, copy: LostCopy) -> bool:
        """Return whether this thread has the copy now; others of the same folder may be taken."""
        folder = copy.path.parent
        with self._lock:
            if copy.key in self._taken:
                return False
            stack, count = self._held.get(folder, (contextlib.ExitStack(), 0))
            if count == 0 and folder != self._root and not _held_soon(stack, folder):
                return False
            self._held[folder] = stack, count + 1
            self._taken.add(copy.key)
            return True

    def _let_go(self, copy: LostCopy) -> None:
        folder = copy.path.parent
        with self._lock:
            self._taken.discard(copy.key)
            stack, count = self._held.pop(folder)
            if count > 1:
                self._held[folder] = stack, count - 1
            else:
                stack.close()

    def discard(self, key: str) -> None:
        """Remove a copy for good; errors as in `held`."""
        with self.held(key) as copy:
            copy.remove()

    def _copies(self) -> list[LostCopy]:
        with self._lock:  # a folder that this program holds is not held by one that runs
            folders = {*dead_folders(self._root), *self._held} - {self._root}
        found = [LostCopy(f"{f.name}-{p.stem}", p) for f in folders for p in f.glob(f"*{SUFFIX}")]
        old = self._root.glob(f"*{SUFFIX}")  # of a version that had one folder for all programs
        return sorted([*found, *(LostCopy(p.stem, p) for p in old)], key=lambda copy: copy.key)


def _held_soon(stack: contextlib.ExitStack, folder: Path) -> bool:
    """Hold a dead folder; somebody who only looks whether it is dead holds it for a moment."""
    for _ in range(TRIES):
        if stack.enter_context(hold(folder)):
            return True
        stack.close()
        time.sleep(WAIT_S)
    return False


def restore(store: Store, journal: Journal) -> str | None:
    """Do again in ``store`` what a journal adds to its copy; returns what was amiss, or None."""
    failed = replay_entries(store, journal.entries)
    return failed or journal.problem


def _drop_folder(folder: Path) -> None:
    if folder.name == FOLDER:  # that of all programs stays
        return
    with contextlib.suppress(OSError):  # an empty folder too many does no harm
        remove_if_empty(folder)


def _describe(copy: LostCopy) -> LostSession:
    files = [path.stat() for path in (copy.path, copy.journal) if path.exists()]
    changed = datetime.fromtimestamp(max(s.st_mtime for s in files), UTC)
    when, size = changed.isoformat(timespec="seconds"), sum(s.st_size for s in files)
    try:
        base, journal = copy.load()
        store = Store(base)
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
