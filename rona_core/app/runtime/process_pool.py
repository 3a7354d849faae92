"""A small pool of processes for what only computes, so that the server always answers.

A process is disposable: it holds nothing but the computation that it is busy with. One that was
killed is replaced, and one that does not heed Cancel is ended.
"""

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
import time
import traceback
from collections.abc import Callable
from functools import cache
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import CancelledError, RonaError

T = TypeVar("T")
POLL_S = 0.05
PROGRESS_PERIOD_S = 0.05
GRACE_S = 0.4  # from Cancel to the end of a process that has not looked at it
CANCEL = b""  # instead of a computation


@cache
def use_one_thread() -> None:
    """Limit the linear algebra of this process to one thread, once and for good.

    On several threads, sums are taken in an order that depends on their number, and the last bits
    of a result with it. A replay compares results bit by bit.
    """
    ThreadpoolController().limit(limits=1)


def _serve(pipe: Connection) -> None:
    """Compute what comes through ``pipe``, one after the other, until its other end is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in a terminal reaches this process too
    use_one_thread()
    tasks: SimpleQueue[bytes] = SimpleQueue()
    cancelled = threading.Event()
    threading.Thread(target=_listen, args=(pipe, tasks, cancelled), daemon=True).start()
    _say(pipe, "ready", None)
    while True:
        task = tasks.get()
        _say(pipe, "begun", None)
        try:
            function, args = pickle.loads(task)
            end = "result", function(*args, progress=_reporter(pipe), cancel=cancelled.is_set)
        except Exception as error:
            if not isinstance(error, RonaError):
                error.add_note(traceback.format_exc())  # of this process; it travels with the error
            end = "error", error
        try:
            _say(pipe, *end)
        except Exception as error:  # it cannot be pickled
            _say(pipe, "error", TypeError(f"the outcome cannot leave its process: {error}"))


def _listen(pipe: Connection, tasks: SimpleQueue[bytes], cancelled: threading.Event) -> None:
    """Take computations and Cancel; end this process at once when the one that asked is gone."""
    while True:
        try:
            message = pipe.recv_bytes()
        except (EOFError, OSError):
            os._exit(0)  # also in the middle of a computation: nobody waits for it any more
        if message == CANCEL:
            cancelled.set()
        else:
            cancelled.clear()  # it was meant for the computation before
            tasks.put(message)


def _say(pipe: Connection, kind: str, value: object) -> None:
    message = pickle.dumps((kind, value))
    try:
        pipe.send_bytes(message)
    except OSError:
        os._exit(0)  # as when listening: nobody waits for it any more


def _reporter(pipe: Connection) -> Progress:
    """Return a function that reports progress at most 20 times a second."""
    reported_s = -PROGRESS_PERIOD_S

    def progress(share: float) -> None:
        nonlocal reported_s
        now_s = time.monotonic()
        if now_s - reported_s > PROGRESS_PERIOD_S or share >= 1.0:
            reported_s = now_s
            _say(pipe, "progress", float(share))

    return progress


class _GoneError(Exception):
    """The process at the other end of the pipe has ended."""


class _NotBegunError(Exception):
    """The process had ended before it took the computation: another one can."""


class _Worker:
    """A spawned process and the pipe to it."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, far = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(far,), name="rona-compute", daemon=True
        )
        self._process.start()
        far.close()  # so that the process alone holds it, and its end is heard here
        self._ready = False  # it has imported what it needs, and listens
        self._busy = False
        self._gone = False  # its pipe has ended: so has it, or it will in a moment

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid or 0

    @property
    def usable(self) -> bool:
        """Whether it lives and waits for a computation."""
        return not self._busy and not self._gone and self._process.is_alive()

    def kill(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join(1.0)

    def compute(self, task: bytes, progress: Progress, cancel: Cancel) -> Any:
        """Return what a pickled (function, args) gives; raise what it raises.

        Raises:
            CancelledError: somebody cancelled.
            RonaError: the process ended in the middle.
            _NotBegunError: it had ended before.
        """
        begun, cancelled_s = False, None  # cancelled_s: when Cancel was sent
        try:
            while True:
                if cancelled_s is None and cancel():
                    if not self._busy:
                        raise CancelledError("cancelled before it began")
                    cancelled_s = time.monotonic()
                    self._send(CANCEL)
                if self._ready and not self._busy:  # it reads at once, however large the task is
                    self._busy = True
                    self._send(task)
                kind, value = self._receive()
                begun = begun or kind == "begun"
                if kind == "progress":
                    progress(value)
                elif kind in ("result", "error"):
                    self._busy = False
                    break
                if cancelled_s is not None and time.monotonic() - cancelled_s > GRACE_S:
                    raise CancelledError("cancelled")  # still busy: it will be replaced
        except _GoneError as error:
            if cancelled_s is not None:
                raise CancelledError("cancelled") from error
            if not begun:
                raise _NotBegunError from error
            raise RonaError("the computing process ended unexpectedly: start it again") from error
        if cancelled_s is not None:
            raise CancelledError("cancelled")
        if kind == "error":
            raise value
        return value

    def _send(self, message: bytes) -> None:
        try:
            self._pipe.send_bytes(message)
        except OSError as error:
            self._gone = True
            raise _GoneError from error

    def _receive(self) -> tuple[str, Any]:
        """Return what it says; ``("silent", None)`` where it says nothing for a while."""
        try:
            if not self._pipe.poll(POLL_S):
                return "silent", None
            message = self._pipe.recv_bytes()
        except (EOFError, OSError) as error:
            self._gone = True
            raise _GoneError from error
        self._ready = True
        return pickle.loads(message)


class ProcessCompute:
    """Runs functions in spawned processes; satisfies ``toolbox.Compute``."""

    def __init__(self, workers: int = 1) -> None:
        self._changed = threading.Condition()
        self._idle: list[_Worker | None] = [None] * workers  # None: one that is still to be started
        self._busy: set[_Worker] = set()
        self._open = True

    @property
    def pids(self) -> tuple[int, ...]:
        """Numbers of the processes that were started, busy ones first."""
        with self._changed:
            return tuple(w.pid for w in (*self._busy, *self._idle) if w is not None)

    def warm_up(self) -> None:
        """Start the processes now, so that the first computation does not wait for them."""
        with self._changed:
            self._idle = [worker or _Worker() for worker in self._idle]

    def __call__(
        self, function: Callable[..., T], *args: object, progress: Progress, cancel: Cancel
    ) -> T:
        """Compute in a process; raises what the function raises, or CancelledError."""
        task = pickle.dumps((function, args))
        try:
            return self._compute(task, progress, cancel)
        except _NotBegunError:  # killed while it waited: nothing was begun, so nothing is lost
            pass
        try:
            return self._compute(task, progress, cancel)
        except _NotBegunError as error:
            raise RonaError("the computing process could not be started: try again") from error

    def _compute(self, task: bytes, progress: Progress, cancel: Cancel) -> Any:
        worker = self._take(cancel)
        try:
            return worker.compute(task, progress, cancel)
        finally:
            self._give_back(worker)

    def _take(self, cancel: Cancel) -> _Worker:
        with self._changed:
            while not self._idle:
                if cancel():
                    raise CancelledError("cancelled before it began")
                self._changed.wait(POLL_S)
            if not self._open:
                raise CancelledError("the program ends")
            worker = self._idle[-1]
            if worker is None or not worker.usable:
                worker = _Worker()
            self._idle.pop()
            self._busy.add(worker)
            return worker

    def _give_back(self, worker: _Worker) -> None:
        """Keep a process that waits for the next computation; replace one that does not."""
        if not worker.usable:
            worker.kill()
        with self._changed:
            self._busy.discard(worker)
            self._idle.append(worker if worker.usable else None)
            self._changed.notify()
            if self._open:
                with contextlib.suppress(OSError):  # no room for a process: tried again when needed
                    self._idle = [held or _Worker() for held in self._idle]

    def close(self) -> None:
        """End the processes, busy or not; a second call does nothing."""
        with self._changed:
            self._open = False
            workers = [*self._busy, *(worker for worker in self._idle if worker is not None)]
            self._idle = [None] * len(self._idle)
        for worker in workers:
            worker.kill()
