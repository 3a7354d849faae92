"""Activities as jobs: start, list, ask, follow, cancel."""

import time
from collections.abc import AsyncIterator, Callable
from dataclasses import asdict, dataclass, fields
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Response

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.jobs import JobState, JobStatus
from rona_core.app.runtime.session_step import Replay, StartReplay
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.maps.comparison import MapComparison
from rona_core.errors import NotFoundError
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import PREFIX, Bench, Open, Sessions
from rona_ui.api.problems import JobFinishedError
from rona_ui.api.routes.commands import body_of, declared_routes
from rona_ui.api.routes.maps import ComparisonInfo, comparison_info
from rona_ui.api.streams import ALIVE, DESCRIBED, EventStream, Streams, event

router = APIRouter(route_class=BodyRoute, tags=["jobs"])


@dataclass(frozen=True, slots=True)
class JobInfo:
    """How a job stands."""

    id: str
    session: str
    activity: str
    state: JobState
    finished: bool
    progress: float  # 0 to 1
    version: int  # grows with every change
    error_code: str | None
    error: str | None
    revision: int | None  # of the session, once the outcome is stored
    result: Replay | ComparisonInfo | None  # what `StartReplay` or `StartComparison` found
    time_left_s: float | None  # an estimate; null while unknown


def job_info(bench: Workbench, status: JobStatus) -> JobInfo:
    """Return how a job stands, with its session."""
    held = {field.name: getattr(status, field.name) for field in fields(status)}
    del held["started_s"]  # of a clock that only this process has
    if isinstance(status.result, MapComparison):
        held["result"] = comparison_info(status.result)
    left_s = status.time_left_s(time.monotonic())
    return JobInfo(session=bench.session.id, finished=status.finished, time_left_s=left_s, **held)


def start(bench: Workbench, activity: Any, response: Response) -> JobInfo:
    """Start an activity and say where to ask for it.

    Raises:
        StepBlockedError: an earlier step is missing or stale.
        DeviceError: the devices are busy.
    """
    status = bench.start(activity)
    response.headers["Location"] = f"{PREFIX}/jobs/{status.id}"
    return job_info(bench, status)


@router.post("/sessions/{session_id}/replay", status_code=202, tags=["results"])
def replay_session(bench: Bench, response: Response) -> JobInfo:
    """Compute every result again from the captures and compare; the same as job `StartReplay`."""
    return start(bench, StartReplay(), response)


async def _bench_of_job(hub: Sessions, job_id: str) -> Workbench:
    for bench in hub.all():
        if any(status.id == job_id for status in bench.jobs.all()):
            return bench
    raise NotFoundError(f"there is no job {job_id!r}")


JobBench = Annotated[Workbench, Depends(_bench_of_job)]


@router.get("/jobs")
def list_jobs(hub: Sessions) -> list[JobInfo]:
    """List the jobs of all open sessions, oldest first in each."""
    return [job_info(bench, status) for bench in hub.all() for status in bench.jobs.all()]


@router.get("/jobs/{job_id}")
def get_job(bench: JobBench, job_id: str) -> JobInfo:
    """Return how a job stands."""
    return job_info(bench, bench.jobs.status(job_id))


@router.delete("/jobs/{job_id}", status_code=202)
def cancel_job(bench: JobBench, job_id: str) -> JobInfo:
    """Ask a job to end; what was measured so far is kept. 409 if it has ended."""
    status = bench.jobs.status(job_id)
    if status.finished:
        raise JobFinishedError(f"job {job_id} has ended already: it is {status.state}")
    bench.jobs.cancel(job_id)
    return job_info(bench, bench.jobs.status(job_id))


@router.get("/jobs/{job_id}/events", response_class=EventStream, responses=DESCRIBED)
async def job_events(bench: JobBench, job_id: str, streams: Open) -> EventStream:
    """Follow a job by server-sent events until it ends."""
    return EventStream(_events(bench, job_id, streams))


async def _events(bench: Workbench, job_id: str, streams: Streams) -> AsyncIterator[bytes]:
    with streams.waker(bench.jobs.subscribe) as waker:
        seen = -1
        while not streams.closing:
            status = bench.jobs.status(job_id)
            if status.version > seen:
                seen = status.version
                yield event(asdict(job_info(bench, status)), kind="job", number=seen)
            if status.finished:
                return
            if not await waker.wait():
                yield ALIVE


def _handler(kind: type) -> Callable[..., JobInfo]:
    def begin(bench: Bench, response: Response, activity: Any) -> JobInfo:
        return start(bench, activity, response)

    begin.__annotations__["activity"] = body_of(kind)
    return begin


def declared_jobs() -> APIRouter:
    """Return a route for each activity that the steps declare."""
    return declared_routes("jobs", REGISTRY.activity_types, _handler, status_code=202)
