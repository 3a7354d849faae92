"""Bindings: the ordered queue that carries messages from widgets to the current session."""

import heapq
import html
import itertools
import sys
import threading
import time
import traceback
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, Protocol

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.session_registry import SessionRegistry
from rona_core.errors import RonaError, storage_error
from rona_ui.labels import in_words

DEBOUNCE_S = 0.4  # a field sends its message once it has been left alone for so long
NOTICE_S = 12.0

TITLES = {
    "invalid_input": "Invalid value",
    "degenerate_geometry": "Data not sufficient",
    "not_reachable": "Not reachable",
    "device_error": "Device error",
    "step_blocked": "Step blocked",
    "stale_result": "Out of date",
    "not_found": "Not found",
    "name_taken": "Name already in use",
    "file_changed": "File changed by another program",
    "session_format": "File cannot be opened",
    "storage": "File cannot be written or read",
    "cancelled": "Cancelled",
}


class Event(Protocol):
    """Event of a widget: ``client`` is None where the program wrote the value."""

    @property
    def client(self) -> Any: ...  # noqa: D102


@dataclass(order=True)
class _Task:
    due_s: float
    number: int
    work: Callable[[], Any]
    client: Any
    key: Hashable


def escape(text: object) -> str:
    """Return ``text`` so that it can stand in HTML."""
    return html.escape(str(text), quote=True)


class Bindings:
    """Carries messages from widgets to the current session, in the order in which they came."""

    def __init__(
        self,
        hub: SessionRegistry,
        on_refusal: Callable[[Any, str, str, bool], None] = lambda client, title, body, explained: (
            None
        ),
    ) -> None:
        """Start the queue; ``on_refusal(client, title, body, explained)`` receives refusals.

        ``explained`` says that the reason stands beside what was refused.
        """
        self._hub = hub
        self._on_refusal = on_refusal
        self._ready = threading.Condition()
        self._tasks: list[_Task] = []
        self._number = itertools.count()
        self._open = True
        self._thread = threading.Thread(target=self._run, name="rona-messages", daemon=True)
        self._thread.start()

    # -------------------------------------------------------------- what widgets call

    def send(self, make: Callable[[], Any], event: Event) -> None:
        """Send the command or activity that ``make()`` returns, unless we wrote the value.

        ``make`` runs in the queue too, so that a value out of range is reported like any refusal.
        """
        if event.client is not None:
            self._put(lambda: self._deliver(make()), event.client)

    def send_debounced(self, key: Hashable, make: Callable[[], Any], event: Event) -> None:
        """Send like ``send``, but only once nothing has come under ``key`` for a moment.

        Where ``make()`` returns None by then, it has been taken back.
        What was typed has been finished by Enter: it does not wait.
        """
        if event.client is not None:
            wait_s = 0.0 if getattr(event, "finished", False) else DEBOUNCE_S
            self._put(lambda: self._deliver(make()), event.client, key=key, wait_s=wait_s)

    def call(self, work: Callable[[], Any], event: Event) -> None:
        """Do something else with the service (save, open, pick) in the same order."""
        if event.client is not None:
            self._put(work, event.client)

    def escape(self, leave: Callable[[], None], event: Event) -> None:
        """Stop the robot if it moves, ahead of all that waits in the queue; else ``leave()``."""

        def stop_or_leave() -> None:
            if not self._hub.get().stop_if_moving():
                leave()

        if event.client is not None:
            arguments = stop_or_leave, event.client
            threading.Thread(target=self._run_guarded, args=arguments, daemon=True).start()

    def refuse(self, error: Exception, event: Event, explained: bool = False) -> None:
        """Tell why something was not done that never came as far as the queue."""
        if event.client is not None:
            self._on_refusal(event.client, *error_words(error), explained)

    # -------------------------------------------------------------- the queue

    def _deliver(self, message: Any) -> None:
        if message is None:
            return
        bench = self._hub.get()
        if type(message).__name__ in REGISTRY.activity_types:
            bench.start(message)
        else:
            bench.dispatch(message)

    def _put(
        self, work: Callable[[], Any], client: Any, key: Hashable = None, wait_s: float = 0.0
    ) -> None:
        with self._ready:
            now_s = time.monotonic()
            if key is not None:
                self._tasks = [task for task in self._tasks if task.key != key]
            else:  # a field changed before this click counts before it
                for task in self._tasks:
                    task.due_s = min(task.due_s, now_s)
            heapq.heapify(self._tasks)
            due_s = now_s + wait_s
            heapq.heappush(self._tasks, _Task(due_s, next(self._number), work, client, key))
            self._ready.notify()

    def _next(self) -> _Task | None:
        with self._ready:
            while self._open:
                if not self._tasks:
                    self._ready.wait()
                elif (wait_s := self._tasks[0].due_s - time.monotonic()) > 0:
                    self._ready.wait(wait_s)
                else:
                    return heapq.heappop(self._tasks)
            return None

    def _run(self) -> None:
        while (task := self._next()) is not None:
            self._run_guarded(task.work, task.client)

    def _run_guarded(self, work: Callable[[], Any], client: Any) -> None:
        try:
            work()
        except Exception as error:  # reported in the browser; the queue goes on
            self._on_refusal(client, *error_words(error), False)

    def close(self) -> None:
        """End the queue; what waits in it is dropped."""
        with self._ready:
            self._open = False
            self._ready.notify_all()


def error_words(error: Exception) -> tuple[str, str]:
    """Return title, and cause and remedy of an error; its stack trace goes to the server log."""
    if isinstance(error, OSError):
        error = storage_error(error)
    if isinstance(error, RonaError):
        return TITLES.get(error.code, "Refused"), in_words(str(error))
    traceback.print_exception(error, file=sys.stderr)
    return "Internal error", "Defect in RONA: nothing was changed. See the server log."


def notify(client: Any, title: str, body: str, color: str = "blue") -> None:
    """Show a notice in one browser; one that has gone is no reason to stop."""
    try:
        client.add_notification(title, body, color=color, auto_close_seconds=NOTICE_S)
    except Exception:  # the browser left while we spoke
        traceback.print_exc(file=sys.stderr)
