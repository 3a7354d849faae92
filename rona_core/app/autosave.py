"""Keep a copy of every changed session, so that a crash costs seconds of work at most."""

import contextlib
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rona_core.app.store import Store
from rona_core.session.document import Session
from rona_core.session.files import SUFFIX, save_session

DELAY_S = 2.0  # from the first change that the copy lacks
RETRY_S = 20.0  # after a copy that could not be written
FOLDER = ".autosave"
CopyState = Literal["none", "kept", "failed"]  # failed: no room, or no right to write


@dataclass(slots=True)
class _Watched:
    store: Store
    unsubscribe: Callable[[], None]
    written: int  # revision that is in the copy or the file
    due_s: float | None = None
    copied: bool = False
    failed: bool = False  # the last time it was tried


class Autosave:
    """Writes a session two seconds after a change, in a thread of its own.

    The copies lie in ``folder``, one per session, named by its id. A copy goes when its session is
    saved or closed, and stays when the program ends without either.
    """

    def __init__(
        self, folder: Path, on_change: Callable[[], None], delay_s: float = DELAY_S
    ) -> None:
        """Keep copies under ``folder``; ``on_change()`` is called when a state has changed."""
        self._folder = folder / FOLDER
        self._delay_s = delay_s
        self._on_change = on_change
        self._condition = threading.Condition()
        self._writing = threading.Lock()  # one copy is written at a time
        self._watched: dict[str, _Watched] = {}
        self._closed = False
        self._thread: threading.Thread | None = None

    def file(self, session_id: str) -> Path:
        """Return where the copy of a session is kept while there is one."""
        return self._folder / f"{session_id}{SUFFIX}"

    def state(self, session_id: str) -> CopyState:
        """Return how the copy of a session stands."""
        watched = self._watched.get(session_id)
        if watched is not None and watched.failed:
            return "failed"
        return "kept" if watched is not None and watched.copied else "none"

    def watch(self, store: Store) -> None:
        """Keep copies of a session from now on."""
        key = store.session.id

        def changed(old: Session, new: Session) -> None:
            self._schedule(key)

        with self._condition:
            self._watched[key] = _Watched(store, store.subscribe(changed), store.revision)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="rona-autosave", daemon=True)
                self._thread.start()

    def keep(self, session: Session) -> None:
        """Write the copy now if it lacks anything; a failure is remembered, told and not raised."""
        with self._writing:
            watched = self._watched.get(session.id)
            if watched is None or watched.written >= len(session.log):
                return
            try:
                save_session(session, self.file(session.id), backup=False)
                watched.written, watched.copied, watched.failed = len(session.log), True, False
            except Exception as error:  # no room, no right to write: work goes on without a copy
                if not watched.failed:
                    sys.stderr.write(f"no copy of session {session.id} is kept: {error}\n")
                watched.failed = True
        if watched.failed:
            self._schedule(session.id, RETRY_S)
        self._on_change()

    def saved(self, session: Session) -> None:
        """Take note that ``session`` is in a file of its own: its copy is not needed any more."""
        with self._writing:
            watched = self._watched.get(session.id)
            if watched is not None and watched.written <= len(session.log):
                watched.written, watched.copied, watched.failed = len(session.log), False, False
                self._remove(session.id)

    def forget(self, session_id: str) -> None:
        """Drop a session and its copy; the user has closed it."""
        self._drop(session_id)
        with self._writing:
            self._remove(session_id)

    def _remove(self, session_id: str) -> None:
        with contextlib.suppress(OSError):  # a copy too many does no harm
            self.file(session_id).unlink(missing_ok=True)

    def close(self) -> None:
        """Write what is not written yet, and end; a second call does nothing."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()
        for key in tuple(self._watched):
            self.keep(self._watched[key].store.session)
            self._drop(key)

    def _drop(self, key: str) -> None:
        with self._condition:
            watched = self._watched.pop(key, None)
        if watched is not None:
            watched.unsubscribe()

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
                self.keep(watched.store.session)

    def _due(self) -> list[_Watched]:
        now_s = time.monotonic()
        return [w for w in self._watched.values() if w.due_s is not None and w.due_s <= now_s]
