"""What is killed and what survives it: computing processes, the server, and how soon it ends.

Linux alone: processes are looked up in /proc.
"""

import contextlib
import os
import signal
import tempfile
import time
import warnings
from collections.abc import Callable
from itertools import product
from multiprocessing import resource_tracker
from pathlib import Path

from benchmarks.metric import Metric, Progress
from benchmarks.reliability.server_process import left_after, server
from rona_core.app.runtime.process_pool import ProcessCompute
from rona_core.devices.protocols import Cancel, never, silent
from rona_core.devices.protocols import Progress as Report
from rona_core.errors import CancelledError, RonaError

KILLS = int(os.environ.get("KILLS", "50"))  # of each kind
ENDS = 5  # of each kind
BUSY = (False, True)  # a server at rest, and one in the middle of a job
KILLED = ("worker", "worker and resource tracker")  # the library starts that one beside it
TEXT = "the computing process ended unexpectedly: start it again"


def double(value: int, *, progress: Report, cancel: Cancel) -> int:
    """Return twice the value: the next job."""
    return 2 * value


def toil(*, progress: Report, cancel: Cancel) -> None:
    """Report progress and work on, until cancelled."""
    while not cancel():
        progress(0.5)
        time.sleep(0.01)
    raise CancelledError("cancelled")


def stay(*, progress: Report, cancel: Cancel) -> None:
    """Work that never looks at Cancel."""
    progress(0.5)
    time.sleep(3600.0)


def run(progress: Progress) -> list[Metric]:
    """Return how many of the kills did harm, and how long it takes to end and to cancel."""
    return [*_workers(progress), *_servers(progress)]


def _workers(progress: Progress) -> list[Metric]:
    pool = ProcessCompute()
    pool.warm_up()

    def kill_worker() -> None:
        os.kill(pool.pids[0], signal.SIGKILL)

    def kill_tracker() -> None:
        """Kill the one process more that the standard library starts beside a spawned one."""
        tracker = vars(resource_tracker)["_resource_tracker"]  # it has no public name
        os.kill(vars(tracker)["_pid"], signal.SIGKILL)

    def next_job_works(number: int) -> bool:
        with contextlib.suppress(RonaError):
            return pool(double, number, progress=silent, cancel=never) == 2 * number
        return False

    def idle(kill: Callable[[], None], number: int) -> bool:
        kill()
        return next_job_works(number)

    def busy(kill: Callable[[], None], number: int) -> bool:
        try:
            pool(toil, progress=lambda share: kill(), cancel=never)
        except RonaError as error:
            return str(error) == TEXT and next_job_works(number)
        return False

    def tracker_too() -> None:
        kill_tracker()
        kill_worker()

    metrics: list[Metric] = []
    kills = {"worker": kill_worker, "worker and resource tracker": tracker_too}
    kinds = {"idle": idle, "busy": busy}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tracker's death is told by a warning
        for name, state in product(KILLED, kinds):
            progress(f"{KILLS} kills: {name}, {state}")
            bad = sum(not kinds[state](kills[name], number) for number in range(KILLS))
            text = f"{name}, {state} killed: next job lost, of {KILLS}"
            metrics.append(Metric(text, bad, "kills", "lower", 0.0))
    progress("cancel of what does not look at it")
    metrics.append(Metric("deaf computation: cancel", _cancel_s(pool), "s", "lower", 1.0))
    pool.close()
    return metrics


def _cancel_s(pool: ProcessCompute) -> float:
    """Return the longest time from Cancel to the end of a computation that ignores it."""
    worst_s = 0.0
    for _ in range(ENDS):
        asked_s: list[float] = []
        with contextlib.suppress(CancelledError):
            pool(
                stay,
                progress=lambda share, asked_s=asked_s: asked_s.append(time.monotonic()),
                cancel=lambda asked_s=asked_s: bool(asked_s),
            )
        worst_s = max(worst_s, time.monotonic() - asked_s[0])
    return worst_s


def _servers(progress: Progress) -> list[Metric]:
    metrics: list[Metric] = []
    for busy in BUSY:
        name = "mid-job" if busy else "idle"
        progress(f"{KILLS} kills: server, {name}")
        left = sum(_left(busy) for _ in range(KILLS))
        text = f"server killed {name}: processes left after 10 s, of {KILLS} kills"
        metrics.append(Metric(text, left, "processes", "lower", 0.0))
    for busy in BUSY:
        name = "mid-job, two streams open" if busy else "idle"
        progress(f"Ctrl-C, {name}")
        times_s = [_end_s(busy) for _ in range(ENDS)]
        metrics.append(Metric(f"Ctrl-C {name}: worst of {ENDS}", max(times_s), "s", "lower", 2.0))
    return metrics


def _left(busy: bool) -> int:
    with tempfile.TemporaryDirectory() as folder, server(Path(folder)) as started:
        if busy:
            started.compute()
        children = started.children
        started.process.kill()
        return left_after([started.process.pid, *children])


def _end_s(busy: bool) -> float:
    with contextlib.ExitStack() as held:
        folder = held.enter_context(tempfile.TemporaryDirectory())
        started = held.enter_context(server(Path(folder)))
        if busy:
            started.compute()
            for path in ("/status/events", "/sessions/current/robot/stream"):
                held.enter_context(started.open(path))
        began_s = time.monotonic()
        started.process.send_signal(signal.SIGINT)
        started.process.wait(60)
        return time.monotonic() - began_s
