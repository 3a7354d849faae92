"""Where the patients of a study are run: processes of this machine, or the workers of Dask.

Both run one function on many patients and yield each with its outcome, as it comes. A worker that
dies costs its patient alone, which is tried once more. Dask is an extra and imported here alone
(``docs/decisions/0018-dask-for-studies.md``).
"""

import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import islice
from typing import Any, Protocol, TypeVar

from rona_core.app.runtime.process_pool import ProcessCompute
from rona_core.errors import DeviceError, InvalidInputError, RonaError
from rona_core.study.plan import Patient

T = TypeVar("T")
TRIES = 2  # of a patient whose worker dies
CONNECT_S = 10.0
INSTALL = "pip install 'rona[study]'"
OF_DASK = {
    "distributed.scheduler.allowed-failures": TRIES - 1,
    # a patient takes half a minute: what looks for changes many times a second takes 5 % of a core
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.client.heartbeat": "30s",
    "distributed.client.scheduler-info-interval": "30s",
}


class WorkerDiedError(RonaError):
    """The worker of a patient died, and so did the next one that was given it."""

    code = "worker_died"


class Engine(Protocol):
    """Runs functions on patients."""

    words: str  # where they are run

    def workers(self) -> int:
        """Return how many patients are run at a time."""
        ...

    def each(
        self, function: Callable[..., T], patients: Iterable[Patient]
    ) -> Iterator[tuple[Patient, T | WorkerDiedError]]:
        """Run a function on patients and yield each with its outcome, in the order of their ends.

        Raises:
            RonaError: what the function raises; the others are given up.
        """
        ...


@contextmanager
def opened(scheduler: str | None, workers: int) -> Generator[Engine]:
    """Yield what patients are run on, and end it.

    Args:
        scheduler: Address of a scheduler of Dask, whose workers are the user's own. None: workers
            of this machine, by Dask where it is installed.
        workers: How many of them; idle where there is a scheduler.

    Raises:
        InvalidInputError: a scheduler, and Dask is not installed.
        DeviceError: there is no such scheduler, or it has no worker.
    """
    if find_spec("distributed") is not None:
        with _dask(scheduler, workers) as engine:
            yield engine
    elif scheduler is not None:
        raise InvalidInputError(f"--scheduler needs Dask, which is an extra: {INSTALL}")
    else:
        with processes(workers) as engine:
            yield engine


# ------------------------------------------------------------------ processes of this machine


@contextmanager
def processes(workers: int) -> Generator[Engine]:
    """Yield an engine of processes that end with this one, however that ends."""
    pool = ProcessCompute(workers)
    try:
        yield _Processes(pool, workers)
    finally:
        pool.close()


class _Processes:
    def __init__(self, pool: ProcessCompute, workers: int) -> None:
        self.words = f"{workers} processes of this machine"
        self._pool, self._workers = pool, workers

    def workers(self) -> int:
        return self._workers

    def each(
        self, function: Callable[..., T], patients: Iterable[Patient]
    ) -> Iterator[tuple[Patient, T | WorkerDiedError]]:
        stopped, todo = threading.Event(), iter(patients)
        with ThreadPoolExecutor(self._workers) as threads:  # each waits for one process

            def begin(patient: Patient) -> Future[T | WorkerDiedError]:
                return threads.submit(self._run, function, patient, stopped)

            running = {begin(patient): patient for patient in islice(todo, self._workers)}
            try:
                while running:
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        patient, outcome = running.pop(future), future.result()
                        running |= {begin(following): following for following in islice(todo, 1)}
                        yield patient, outcome
            finally:
                stopped.set()

    def _run(
        self, function: Callable[..., T], patient: Patient, stopped: threading.Event
    ) -> T | WorkerDiedError:
        reason = ""
        for _ in range(TRIES):
            try:
                return self._pool(function, patient, progress=_unseen, cancel=stopped.is_set)
            except RonaError as error:
                if type(error) is not RonaError:  # of the function, or stopped
                    raise
                reason = str(error)
        return WorkerDiedError(reason)


def _unseen(share: float) -> None:
    """Show no progress."""


# ------------------------------------------------------------------ Dask


@contextmanager
def _dask(scheduler: str | None, workers: int) -> Generator[Engine]:
    import dask.config
    from distributed import Client, LocalCluster

    if scheduler is not None:
        try:
            client: Any = Client(scheduler, timeout=CONNECT_S)
            client.wait_for_workers(1, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            words = f"no scheduler of Dask with a worker answers at {scheduler}"
            raise DeviceError(f"{words}: start them first ({error})") from error
        with client:
            threads = client.nthreads()
            if set(threads.values()) != {1}:
                raise InvalidInputError("one thread a worker: dask worker --nthreads 1 ...")
            yield _Dask(client, f"{len(threads)} workers of {scheduler}")
        return
    with (
        dask.config.set(OF_DASK),
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        yield _Dask(client, f"{workers} workers of Dask on this machine")


class _Dask:
    def __init__(self, client: Any, words: str) -> None:
        shown = find_spec("bokeh") is not None
        self.words = f"{words}, dashboard {client.dashboard_link}" if shown else words
        self._client = client

    def workers(self) -> int:
        return max(len(self._client.nthreads()), 1)

    def each(
        self, function: Callable[..., T], patients: Iterable[Patient]
    ) -> Iterator[tuple[Patient, T | WorkerDiedError]]:
        from distributed import KilledWorker, as_completed

        todo, running = iter(patients), dict[Any, Patient]()
        ended = as_completed(raise_errors=False)

        def fill() -> None:
            """Give each worker one patient, no more: what waits for one that dies is blamed too."""
            for patient in islice(todo, max(self.workers() - len(running), 0)):
                key = f"{function.__name__}-{patient.key}"
                future = self._client.submit(function, patient, key=key)
                running[future] = patient
                ended.add(future)

        try:
            fill()
            for future in ended:
                patient, outcome = running.pop(future), _outcome(future, KilledWorker)
                fill()
                yield patient, outcome
        finally:
            self._client.cancel(list(running), force=True)


def _outcome(future: Any, killed: type[Exception]) -> Any:
    """Return the result of a future that has ended; raise what its function raised.

    Raises:
        DeviceError: it was lost with its scheduler.
    """
    if future.status == "finished":
        return future.result()
    error = future.exception() if future.status == "error" else None
    if isinstance(error, killed):
        return WorkerDiedError(str(error))
    raise error or DeviceError("the scheduler has gone: run the same command again")
