"""Tell listeners of new sessions from one thread, so that slow drawing never blocks a command."""

import sys
import threading
import traceback
from collections.abc import Callable

from rona_core.session.document import Session

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
