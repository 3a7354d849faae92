"""The one place where the session changes: a lock, a log, and the steps to take back."""

import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from rona_core.app.declarations.declarations import Message
from rona_core.app.messages.message import serialize_arguments
from rona_core.app.runtime.handling import handle
from rona_core.app.runtime.session_step import Redo, Undo
from rona_core.errors import InvalidInputError
from rona_core.session.document import LogEntry, Session

Listener = Callable[[Session, Session], None]


class Notifier:
    """Calls each listener with (the session it saw last, the newest), skipping those between."""

    def __init__(self, session: Session) -> None:
        self._condition = threading.Condition()
        self._newest = session
        self._listeners: dict[int, tuple[Listener, Session]] = {}
        self._next_key = 0
        self._closed = False
        self._thread: threading.Thread | None = None

    def publish(self, session: Session) -> None:
        """Make ``session`` the newest and wake the thread; one that is older is ignored."""
        with self._condition:
            if len(session.log) >= len(self._newest.log):
                self._newest = session
            self._condition.notify_all()

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Add a listener; returns a function that removes it."""
        with self._condition:
            key = self._next_key
            self._next_key += 1
            self._listeners[key] = (listener, self._newest)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="rona-notifier", daemon=True)
                self._thread.start()

        def unsubscribe() -> None:
            with self._condition:
                self._listeners.pop(key, None)

        return unsubscribe

    def close(self) -> None:
        """End the thread; a second call does nothing."""
        with self._condition:
            self._closed = True
            self._listeners.clear()
            self._condition.notify_all()

    def _behind(self) -> list[tuple[int, Listener, Session]]:
        return [
            (key, listener, seen)
            for key, (listener, seen) in self._listeners.items()
            if seen is not self._newest
        ]

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._closed or bool(self._behind()))
                if self._closed:
                    return
                newest, behind = self._newest, self._behind()
                for key, listener, _ in behind:
                    self._listeners[key] = (listener, newest)
            for _, listener, seen in behind:
                try:
                    listener(seen, newest)
                except Exception:  # a listener that fails must not silence the others
                    traceback.print_exc(file=sys.stderr)


UNDO_STEPS = 200


@dataclass(frozen=True, slots=True)
class Change:
    """A session, its revision and the name of the message that made it."""

    revision: int
    message: str
    session: Session


class Store:
    """Holds one session. ``dispatch`` is the only way to change it."""

    def __init__(
        self, session: Session, accept: Callable[[Session, Session], None] | None = None
    ) -> None:
        """Hold ``session``; ``accept(before, after)`` raises where a change must not count."""
        self._accept = accept
        self._lock = threading.RLock()
        self._session = session
        self._undo: list[Session] = []
        self._redo: list[Session] = []
        self._notifier = Notifier(session)

    @property
    def session(self) -> Session:
        """The session now."""
        return self._session

    @property
    def revision(self) -> int:
        """How many messages have changed this session."""
        return len(self._session.log)

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to take back."""
        return bool(self._undo)

    @property
    def can_redo(self) -> bool:
        """Whether there is a change to do again."""
        return bool(self._redo)

    def dispatch(self, message: Message, time_utc: str | None = None) -> Change:
        """Change the session by one message; a message that fails changes nothing.

        Args:
            message: What to do.
            time_utc: When it was done first, where it is done again; else it is now.

        Raises:
            RonaError: the message does not fit the session; its text says why.
        """
        with self._lock:
            before = self._session
            if isinstance(message, Undo):
                after = _restored(before, _pop(self._undo, "there is nothing to undo"))
                self._redo.append(before)
            elif isinstance(message, Redo):
                after = _restored(before, _pop(self._redo, "there is nothing to do again"))
                self._undo.append(before)
            else:
                after = handle(message, before)
                if self._accept is not None:
                    self._accept(before, after)
                self._undo = [*self._undo[-UNDO_STEPS + 1 :], before]
                self._redo.clear()
            entry = LogEntry(
                number=len(before.log) + 1,
                message=type(message).__name__,
                arguments=serialize_arguments(message),
                time_utc=time_utc or datetime.now(UTC).isoformat(timespec="milliseconds"),
            )
            self._session = replace(after, log=(*before.log, entry))
            change = Change(entry.number, entry.message, self._session)
        self._notifier.publish(change.session)
        return change

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Call ``listener(old, new)`` after changes, in order, from one thread; may skip some.

        Returns a function that ends the subscription.
        """
        return self._notifier.subscribe(listener)

    def close(self) -> None:
        """Stop telling listeners; a second call does nothing."""
        self._notifier.close()


def _pop(steps: list[Session], message: str) -> Session:
    if not steps:
        raise InvalidInputError(message)
    return steps.pop()


def _restored(now: Session, then: Session) -> Session:
    """Return ``then``, but keep every capture taken since and the log."""
    return replace(then, archive=now.archive, log=now.log)
