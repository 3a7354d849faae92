"""A small pool of processes for what only computes, so that the server always answers.

A process is disposable: it holds nothing but the computation that it is busy with. One that was
killed or does not answer is replaced, and one that does not heed Cancel is ended.
"""

import contextlib
import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from functools import cache
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import CancelledError, RonaError

T = TypeVar("T")
POLL_S = 0.05
PROGRESS_PERIOD_S = 0.05
GRACE_S = 0.4  # from Cancel to the end of a process that has not looked at it
FROZEN_S = 3.0  # without a word and without any CPU time, until a process counts as frozen
AWAKE_S = 0.25  # how often a process that has nothing else to do takes a little CPU time
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
            while not pipe.poll(AWAKE_S):  # its CPU time shows that it lives, whatever else it does
                pass
            message = pipe.recv_bytes()
        except (EOFError, OSError):
            os._exit(0)  # also in the middle of a computation: its result is not awaited any more
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
        os._exit(0)  # as when listening: its result is not awaited any more


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


class _NotBegunError(Exception):
    """The process took no computation, since it had ended or did not answer: another one can."""


class _Worker:
    """A spawned process and the pipe to it, used by two threads, since either end may block."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, far = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(far,), name="rona-compute", daemon=True
        )
        self._process.start()
        far.close()  # so that the process alone holds it, and its end is noticed here
        self._sent: SimpleQueue[bytes | None] = SimpleQueue()  # None: the thread ends
        self._received: SimpleQueue[bytes | None] = SimpleQueue()  # None: it has ended
        self._ready = False  # it has imported what it needs, and listens
        self._busy = False
        self._gone = False  # it has ended, is about to, or does not answer: it takes nothing more
        self._cpu_s, self._quiet = 0.0, 0  # its CPU time, and looks since that last grew
        for target in (self._send, self._receive):
            threading.Thread(target=target, name="rona-compute-pipe", daemon=True).start()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid or 0

    @property
    def usable(self) -> bool:
        """Whether it lives and waits for a computation."""
        return not self._busy and not self._gone and self._process.is_alive()

    def kill(self) -> None:
        """End the process, whatever it does, frozen or not."""
        self._process.kill()
        self._process.join(1.0)
        self._sent.put(None)

    def compute(self, task: bytes, progress: Progress, cancel: Cancel) -> Any:
        """Return what a pickled (function, args) gives; raise what it raises.

        Raises:
            CancelledError: Cancel was pressed.
            RonaError: the process ended in the middle, or did not answer any more.
            _NotBegunError: so it did before it had begun.
        """
        begun, cancelled_s = False, None  # cancelled_s: when Cancel was sent
        self._quiet = 0
        while True:
            if cancelled_s is None and cancel():
                if not self._busy:
                    raise CancelledError("cancelled before it began")
                cancelled_s = time.monotonic()
                self._sent.put(CANCEL)
            if self._ready and not self._busy:
                self._busy = True
                self._sent.put(task)
            kind, value = self._next()
            begun = begun or kind == "begun"
            if kind == "progress":
                progress(value)
            elif kind in ("result", "error"):
                self._busy = False
                break
            elif kind in ("gone", "frozen"):
                break
            if cancelled_s is not None and time.monotonic() - cancelled_s > GRACE_S:
                raise CancelledError("cancelled")  # still busy: it will be replaced
        if cancelled_s is not None:
            raise CancelledError("cancelled")
        if kind in ("gone", "frozen"):
            if not begun:
                raise _NotBegunError
            what = "ended unexpectedly" if kind == "gone" else "did not answer any more"
            raise RonaError(f"the computing process {what}: start it again")
        if kind == "error":
            raise value
        return value

    def _next(self) -> tuple[str, Any]:
        """Return what it says, ``silent`` where that is nothing for a while, or ``frozen``.

        Looks are counted and not seconds: while this program is stopped itself, it does not look.
        """
        try:
            message = self._received.get(timeout=POLL_S)
        except Empty:
            cpu_s = _cpu_s_of(self.pid)
            self._quiet = self._quiet + 1 if cpu_s == self._cpu_s else 0
            self._cpu_s = cpu_s
            self._gone = self._quiet * POLL_S > FROZEN_S
            return ("frozen" if self._gone else "silent"), None
        if message is None:
            return "gone", None
        self._ready, self._quiet = True, 0
        return pickle.loads(message)

    def _send(self) -> None:
        """Send what is to be sent; a large task blocks this thread until the process reads it."""
        with contextlib.suppress(OSError):  # it has ended, which the other thread notices
            while (message := self._sent.get()) is not None:
                self._pipe.send_bytes(message)

    def _receive(self) -> None:
        """Take what it says, which may come in pieces, until its end of the pipe is gone."""
        with contextlib.suppress(EOFError, OSError):
            while True:
                self._received.put(self._pipe.recv_bytes())
        self._gone = True
        self._received.put(None)


def _cpu_s_of(pid: int) -> float:
    """Return the CPU time of a process so far, in seconds [clock_getcpuclockid(3)].

    Where the system does not say it (macOS) that is the time of now, so that none counts as frozen.
    """
    clock = ctypes.c_int()
    try:
        if ctypes.CDLL(None).clock_getcpuclockid(pid, ctypes.byref(clock)) == 0:
            return time.clock_gettime(clock.value)
    except (AttributeError, OSError):
        pass
    return time.monotonic()


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
        except _NotBegunError:  # killed or frozen while it waited: nothing begun, nothing lost
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


def release_memory() -> None:
    """Give what Python has freed back to the system, where its C library can.

    It lies in pieces between what is held, too small for large arrays: without this a process
    grows by them. It takes some milliseconds, and using the memory again some more.
    """
    trim = _trim()
    if trim is not None:
        trim(0)


@cache
def _trim() -> Any:
    """Return ``malloc_trim`` of the C library (glibc), None where there is none."""
    return getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
