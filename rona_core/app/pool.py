"""A small pool of processes for what only computes, so that the server always answers."""

import multiprocessing
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.managers import SyncManager
from typing import Any

from rona_core.app.threads import use_one_thread
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import CancelledError, RonaError

POLL_S = 0.05
PROGRESS_PERIOD_S = 0.05
_worker_events: Any = None  # set in each worker by its initialiser


def _initialise(events: Any) -> None:
    global _worker_events
    _worker_events = events
    use_one_thread()


def _call(key: int, function: Callable[..., Any], args: tuple[Any, ...], reports: Any) -> Any:
    """Run in the worker: report progress at most 20 times a second, look up Cancel likewise."""
    state = {"time": 0.0, "cancelled": False}

    def progress(share: float) -> None:
        now = time.monotonic()
        if now - state["time"] > PROGRESS_PERIOD_S or share >= 1.0:
            state["time"] = now
            reports.put(float(share))

    checked = {"time": 0.0}

    def cancel() -> bool:
        now = time.monotonic()
        if now - checked["time"] > POLL_S:
            checked["time"] = now
            state["cancelled"] = key in _worker_events
        return bool(state["cancelled"])

    return function(*args, progress=progress, cancel=cancel)


class ProcessCompute:
    """Runs functions in spawned processes; satisfies ``toolbox.Compute``."""

    def __init__(self, workers: int = 1) -> None:
        self._lock = threading.Lock()
        self._workers = workers
        self._manager: SyncManager | None = None
        self._cancelled: Any = None
        self._executor: ProcessPoolExecutor | None = None
        self._next_key = 0

    def warm_up(self) -> None:
        """Start the processes now, so that the first computation does not wait for them."""
        executor, _, _ = self._ready()
        executor.submit(_nothing)

    def _ready(self) -> tuple[ProcessPoolExecutor, SyncManager, int]:
        with self._lock:
            if self._executor is None or self._manager is None:
                context = multiprocessing.get_context("spawn")
                self._manager = context.Manager()
                self._cancelled = self._manager.dict()
                self._executor = ProcessPoolExecutor(
                    self._workers,
                    mp_context=context,
                    initializer=_initialise,
                    initargs=(self._cancelled,),
                )
            self._next_key += 1
            return self._executor, self._manager, self._next_key

    def __call__(
        self, function: Callable[..., Any], *args: Any, progress: Progress, cancel: Cancel
    ) -> Any:
        """Compute in a process; raises what the function raises, or CancelledError."""
        executor, manager, key = self._ready()
        reports = manager.Queue()
        future = executor.submit(_call, key, function, args, reports)
        told = False
        while True:
            try:
                progress(reports.get(timeout=POLL_S))
            except queue.Empty:
                pass
            if cancel() and not told:
                told = True
                self._cancelled[key] = True
                future.cancel()
            if future.done():
                return self._result(future, key, told)

    def _result(self, future: Any, key: int, told: bool) -> Any:
        self._cancelled.pop(key, None)
        if future.cancelled():
            raise CancelledError("cancelled before it began")
        try:
            result = future.result()
        except BrokenProcessPool as error:
            with self._lock:
                self._executor = None  # the next computation starts fresh processes
            raise RonaError("the computing process ended unexpectedly: start it again") from error
        if told:
            raise CancelledError("cancelled")
        return result

    def close(self) -> None:
        """End the processes; a second call does nothing."""
        with self._lock:
            if self._executor is not None:
                self._executor.shutdown(wait=False, cancel_futures=True)
            if self._manager is not None:
                self._manager.shutdown()
            self._executor, self._manager = None, None


def _nothing() -> None:
    """Imports this module in a fresh process, and with it the algorithms' packages."""
