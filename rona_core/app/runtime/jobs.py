"""Jobs: activities under way, with progress, cancel and an outcome that everybody can ask for."""

import threading
import time
import traceback
import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from rona_core.app.declarations.declarations import Message
from rona_core.errors import (
    CancelledError,
    DeviceError,
    NotFoundError,
    RonaError,
    storage_error,
)

JobState = Literal["running", "done", "failed", "cancelled"]
MAX_RUNNING = 8
KEPT = 200  # finished jobs that are remembered
PROGRESS_STEP = 0.005
LEAST_S, LEAST_PROGRESS = 1.5, 0.03  # before the remaining time is shown


@dataclass(frozen=True, slots=True)
class JobStatus:
    """One job as it stands."""

    id: str
    activity: str
    state: JobState
    progress: float  # 0 to 1
    version: int = 0  # grows with every change
    error_code: str | None = None
    error: str | None = None
    revision: int | None = None  # of the session, once the outcome is stored
    result: object = None  # what was found, where the session does not hold it
    started_s: float | None = None  # on the clock of `time.monotonic`

    def time_left_s(self, now_s: float) -> float | None:
        """Return how long the job still takes at its present rate; None while that is unknown."""
        if self.finished or self.started_s is None:
            return None
        passed_s = now_s - self.started_s
        if passed_s < LEAST_S or self.progress < LEAST_PROGRESS:
            return None
        return passed_s * (1.0 - self.progress) / self.progress

    @property
    def finished(self) -> bool:
        """Whether the job has ended, one way or another."""
        return self.state != "running"


@dataclass(frozen=True, slots=True)
class Ended:
    """How work has ended: the revision of the session, and what was found beside it."""

    revision: int
    result: object = None


Work = Callable[[Callable[[float], None], Callable[[], bool]], int | Ended]


class Jobs:
    """Runs each job in a thread of its own; one at a time where devices are involved."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._status: dict[str, JobStatus] = {}
        self._cancel: dict[str, threading.Event] = {}
        self._threads: dict[str, threading.Thread] = {}
        self._device_job: str | None = None
        self._listeners: list[Callable[[JobStatus], None]] = []

    def start(self, activity: Message, work: Work, *, device: bool) -> JobStatus:
        """Start ``work(progress, cancel) -> revision`` and return at once.

        What else it found, it returns with the revision as ``Ended``.

        Raises:
            DeviceError: the devices are busy with another job.
            RonaError: too many jobs are running.
        """
        job = uuid.uuid4().hex[:12]
        status = JobStatus(job, type(activity).__name__, "running", 0.0, started_s=time.monotonic())
        with self._changed:
            running = sum(not known.finished for known in self._status.values())
            if running >= MAX_RUNNING:
                raise RonaError(f"{running} jobs are running: wait for one or cancel it")
            if device and self._device_job is not None:
                busy = self._status[self._device_job]
                raise DeviceError(
                    f"the devices are busy with {busy.activity} (job {busy.id}): "
                    "wait for it or cancel it"
                )
            if device:
                self._device_job = job
            self._forget_oldest()
            self._status[job] = status
            self._cancel[job] = threading.Event()
        thread = threading.Thread(
            target=self._run, args=(job, work), name=f"rona-job-{job}", daemon=True
        )
        self._threads[job] = thread
        thread.start()
        return status

    def _forget_oldest(self) -> None:
        finished = [key for key, status in self._status.items() if status.finished]
        for key in finished[: max(0, len(finished) - KEPT)]:
            for kept in (self._status, self._cancel, self._threads):
                kept.pop(key, None)

    def _run(self, job: str, work: Work) -> None:
        cancel = self._cancel[job]

        def progress(share: float) -> None:
            if abs(share - self._status[job].progress) >= PROGRESS_STEP:
                self._update(job, progress=min(1.0, max(0.0, share)))

        end: dict[str, Any]
        try:
            made = work(progress, cancel.is_set)
            ended = made if isinstance(made, Ended) else Ended(made)
            end = {"state": "done", "progress": 1.0}
            if cancel.is_set():  # stopped early, but what came was stored
                end = {"state": "cancelled"}
            end |= {"revision": ended.revision, "result": ended.result}
        except CancelledError as error:
            end = {"state": "cancelled", "error_code": error.code, "error": str(error)}
        except RonaError as error:
            end = {"state": "failed", "error_code": error.code, "error": str(error)}
        except OSError as error:
            refused = storage_error(error)
            end = {"state": "failed", "error_code": refused.code, "error": str(refused)}
        except Exception as error:  # a defect: the job ends, the program goes on
            traceback.print_exc()
            text = f"{type(error).__name__}: {error}"
            end = {"state": "failed", "error_code": "internal", "error": text}
        with self._changed:
            if self._device_job == job:
                self._device_job = None
        self._update(job, **end)

    def _update(self, job: str, **parts: Any) -> None:
        with self._changed:
            old = self._status[job]
            status = replace(old, version=old.version + 1, **parts)
            self._status[job] = status
            self._changed.notify_all()
            listeners = tuple(self._listeners)
        for listener in listeners:
            listener(status)

    def status(self, job: str) -> JobStatus:
        """Return how a job stands.

        Raises:
            NotFoundError: no such job.
        """
        with self._changed:
            if job not in self._status:
                raise NotFoundError(f"there is no job {job!r}")
            return self._status[job]

    def all(self) -> tuple[JobStatus, ...]:
        """Return all remembered jobs, oldest first."""
        with self._changed:
            return tuple(self._status.values())

    def cancel(self, job: str) -> JobStatus:
        """Ask a job to end; a finished one stays as it is.

        Raises:
            NotFoundError: no such job.
        """
        status = self.status(job)
        self._cancel[job].set()
        return status

    @property
    def devices_busy(self) -> bool:
        """Whether a job uses the devices."""
        return self._device_job is not None

    @property
    def device_activity(self) -> str | None:
        """Name of the activity that uses the devices, None where none does."""
        with self._changed:
            return None if self._device_job is None else self._status[self._device_job].activity

    def cancel_all(self) -> None:
        """Ask every job to end."""
        with self._changed:
            for key, status in self._status.items():
                if not status.finished:
                    self._cancel[key].set()

    def wait_all(self, timeout_s: float) -> bool:
        """Return whether every job has ended, at the latest after the timeout."""
        with self._changed:
            return self._changed.wait_for(
                lambda: all(status.finished for status in self._status.values()), timeout_s
            )

    def cancel_device_job(self) -> None:
        """Ask whatever uses the devices to end."""
        with self._changed:
            job = self._device_job
        if job is not None:
            self._cancel[job].set()

    def wait(self, job: str, timeout_s: float | None = None) -> JobStatus:
        """Return the status once the job has ended, or after the timeout."""
        self.status(job)
        with self._changed:
            self._changed.wait_for(lambda: self._status[job].finished, timeout_s)
            return self._status[job]

    def subscribe(self, listener: Callable[[JobStatus], None]) -> Callable[[], None]:
        """Call ``listener(status)`` after each change; returns a function that ends that."""
        with self._changed:
            self._listeners.append(listener)

        def unsubscribe() -> None:
            with self._changed:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return unsubscribe
