"""Keep a journal of every changed session, so that nothing acknowledged is lost in a crash."""

import contextlib
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from rona_core.app.runtime.saving.journal import (
    JOURNAL_SUFFIX,
    Reach,
    append_entries,
    begin_journal,
    remove_journal,
)
from rona_core.app.runtime.saving.run_folder import RunFolder
from rona_core.app.runtime.store import Store
from rona_core.session.document import Session

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
