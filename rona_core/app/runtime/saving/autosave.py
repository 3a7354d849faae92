"""Keep a copy of every changed session, so that nothing acknowledged is lost in a crash."""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from rona_core.app.runtime.saving.journal import JOURNAL_SUFFIX, Reach, append_entries
from rona_core.app.runtime.saving.run_folder import RunFolder
from rona_core.app.runtime.store import Store
from rona_core.session.document import Session
from rona_core.session.files import SUFFIX, save_session

DELAY_S = 2.0  # from a change until its journal outlives the machine too
RETRY_S = 20.0  # after a copy that could not be written
FOLDER = ".autosave"
CopyState = Literal["none", "kept", "failed"]  # failed: no room, or no right to write


@dataclass(slots=True)
class _Watched:
    store: Store
    unsubscribe: Callable[[], None]
    written: int  # revision that is in the copy with its journal, or in the file
    due_s: float | None = None
    reach: Reach | None = None  # of the journal beside the copy; None where there is no copy
    synced: bool = True  # the journal is on the disk, not only on its way there
    failed: bool = False  # the last time it was tried
    writing: threading.Lock = field(default_factory=threading.Lock)  # one at a time


class Autosave:
    """Writes down what is changed in a session, before the change counts as done.

    A copy is the whole session; commands after it are lines in a journal beside it, which cost
    next to nothing. Where they do not suffice (what a device measured, a step taken back from
    before the copy, a long journal) a whole copy is written anew. They lie in a folder of this
    program alone below ``folder``, named by the id of the session. They go when the session is
    saved or closed, and stay when the program ends without either.
    """

    def __init__(
        self, folder: Path, on_change: Callable[[], None], delay_s: float = DELAY_S
    ) -> None:
        """Keep copies under ``folder``; ``on_change()`` is called when a state has changed."""
        self._folder = RunFolder(folder / FOLDER)
        self._delay_s = delay_s
        self._on_change = on_change
        self._condition = threading.Condition()
        self._watched: dict[str, _Watched] = {}
        self._closed = False
        self._thread: threading.Thread | None = None

    @property
    def run(self) -> str:
        """Name of the folder of this program, which no other one has."""
        return self._folder.path.name

    def file(self, session_id: str) -> Path:
        """Return where the copy of a session is kept while there is one."""
        return self._folder.path / f"{session_id}{SUFFIX}"

    def journal(self, session_id: str) -> Path:
        """Return where the commands after that copy are kept while there are any."""
        return self._folder.path / f"{session_id}{JOURNAL_SUFFIX}"

    def state(self, session_id: str) -> CopyState:
        """Return how the copy of a session stands."""
        watched = self._watched.get(session_id)
        if watched is not None and watched.failed:
            return "failed"
        return "kept" if watched is not None and watched.reach is not None else "none"

    def watch(self, store: Store, *, changed: bool = False) -> None:
        """Keep copies of a session from now on; ``changed`` where no file holds it as it is."""
        key = store.session.id

        def follow(old: Session, new: Session) -> None:
            self._schedule(key)

        with self._condition:
            written = -1 if changed else store.revision
            self._watched[key] = _Watched(store, store.subscribe(follow), written)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="rona-autosave", daemon=True)
                self._thread.start()

    def keep(self, session: Session) -> None:
        """Write down what is not yet; a failure is remembered, told and not raised.

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
            except Exception as error:  # no room, no right to write: work goes on without a copy
                if not watched.failed:
                    sys.stderr.write(f"no copy of session {session.id} is kept: {error}\n")
                watched.failed, watched.reach = True, None
            after = watched.reach is not None, watched.failed
        if watched.failed:
            self._schedule(session.id, RETRY_S)
        if before != after:
            self._on_change()

    def _write(self, watched: _Watched, session: Session) -> None:
        """Add to the journal where that suffices, else write a whole copy."""
        entries = session.log[max(watched.written, 0) :]
        longer = None if watched.reach is None else watched.reach.after(entries)
        if longer is not None and self.file(session.id).exists():  # nobody has cleared it away
            append_entries(self.journal(session.id), entries)
            watched.synced = False
        else:
            self._folder.claim()
            save_session(session, self.file(session.id), backup=False, quick=True)
            self.journal(session.id).unlink(missing_ok=True)
            longer = Reach()
        watched.reach, watched.written, watched.failed = longer, len(session.log), False

    def saved(self, session: Session) -> None:
        """Take note that ``session`` is in a file of its own: its copy is not needed any more."""
        watched = self._watched.get(session.id)
        if watched is None:
            return
        with watched.writing:
            if watched.written <= len(session.log):
                watched.written, watched.reach, watched.failed = len(session.log), None, False
                self._remove(session.id)

    def unsaved(self, session_id: str) -> None:
        """Take note that the file of a session is there no more: a copy is needed, now."""
        watched = self._watched.get(session_id)
        if watched is not None:
            with watched.writing:
                watched.written, watched.reach = -1, None
            self.keep(watched.store.session)

    def forget(self, session_id: str) -> None:
        """Drop a session and its copy; the user has closed it."""
        watched = self._drop(session_id)
        if watched is not None:
            with watched.writing:  # whoever is writing has it removed afterwards
                watched.written = sys.maxsize
                self._remove(session_id)

    def _remove(self, session_id: str) -> None:
        with contextlib.suppress(OSError):  # a copy too many does no harm
            self.journal(session_id).unlink(missing_ok=True)
            self.file(session_id).unlink(missing_ok=True)

    def close(self) -> None:
        """Write what is not written yet, and end; a second call does nothing."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()
        for key in tuple(self._watched):
            self._settle(self._watched[key])
            self._drop(key)
        self._folder.release()

    def _drop(self, key: str) -> _Watched | None:
        with self._condition:
            watched = self._watched.pop(key, None)
        if watched is not None:
            watched.unsubscribe()
        return watched

    def _settle(self, watched: _Watched) -> None:
        """Keep what came on other ways than a workbench, and have the disk hold the journal."""
        session = watched.store.session
        self._keep(watched, session)
        with watched.writing:
            if not watched.synced and watched.reach is not None:
                with contextlib.suppress(OSError):  # then it is the machine that must not fail
                    _sync(self.journal(session.id))
                watched.synced = True

    def _schedule(self, key: str, delay_s: float | None = None) -> None:
        with self._condition:
            watched = self._watched.get(key)
            if watched is not None:
                due_s = time.monotonic() + (self._delay_s if delay_s is None else delay_s)
                watched.due_s = due_s if watched.due_s is None else min(due_s, watched.due_s)
                self._condition.notify_all()

    def _run(self) -> None:
        while True:
            with self._condition:
                due = self._due()
                while not due and not self._closed:
                    times = [w.due_s for w in self._watched.values() if w.due_s is not None]
                    wait_s = max(min(times) - time.monotonic(), 0.0) if times else None
                    self._condition.wait(wait_s)
                    due = self._due()
                if self._closed:
                    return
                for watched in due:
                    watched.due_s = None
            for watched in due:
                self._settle(watched)

    def _due(self) -> list[_Watched]:
        now_s = time.monotonic()
        return [w for w in self._watched.values() if w.due_s is not None and w.due_s <= now_s]


def _sync(path: Path) -> None:
    if path.exists():  # else it has become part of a whole copy
        with path.open("rb") as file:
            os.fsync(file.fileno())
