"""Sessions that a program left behind unsaved when it ended: list them, load one, discard one."""

import contextlib
import threading
from collections.abc import Generator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.step_states import step_states
from rona_core.app.runtime.saving.autosave import FOLDER
from rona_core.app.runtime.saving.journal import (
    JOURNAL_SUFFIX,
    read_journal,
    remove_journal,
    restore,
)
from rona_core.app.runtime.saving.run_folder import dead_folders, hold, remove_if_empty
from rona_core.app.runtime.store import Store
from rona_core.errors import NotFoundError, RonaError
from rona_core.session.files import remove_stale_temporaries


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
