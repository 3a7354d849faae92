"""One route per command, and activities as jobs: start, list, ask, follow, cancel."""

import time
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import MISSING, asdict, dataclass, fields
from typing import Annotated, Any

from fastapi import APIRouter, Body, Depends, Response

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.jobs import JobState, JobStatus
from rona_core.app.runtime.session_step import Redo, Replay, StartReplay, Undo
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.maps.comparison import MapComparison
from rona_core.errors import NotFoundError
from rona_ui.api.bodies import BodyRoute, body_bytes
from rona_ui.api.context import EXACT, PREFIX, Bench, Open, Sessions
from rona_ui.api.problems import JobFinishedError
from rona_ui.api.routes.results import ComparisonInfo, comparison_info
from rona_ui.api.streams import ALIVE, DESCRIBED, EventStream, Streams, event

commands_router = APIRouter(route_class=BodyRoute, tags=["commands"])


@dataclass(frozen=True, slots=True)
class Changed:
    """What a command did: the session has this revision now."""

    command: str
    revision: int


def changed(bench: Workbench, command: Any) -> Changed:
    """Send a command and return what it did."""
    change = bench.dispatch(command)
    return Changed(change.message, change.revision)


def body_of(kind: Any) -> Any:
    """Return the parameter type of a message's body; it may be left out if all has defaults."""
    optional = all(
        field.default is not MISSING or field.default_factory is not MISSING
        for field in fields(kind)
    )
    body = Body(default_factory=kind) if optional else Body()
    return Annotated[kind, EXACT, body]


@commands_router.post("/sessions/{session_id}/undo")
def undo(bench: Bench) -> Changed:
    """Take the last change back; the same as the command `Undo`."""
    return changed(bench, Undo())


@commands_router.post("/sessions/{session_id}/redo")
def redo(bench: Bench) -> Changed:
    """Do again what was taken back; the same as the command `Redo`."""
    return changed(bench, Redo())


def declared_routes(
    tag: str,
    kinds: Mapping[str, type],
    handler: Callable[[type], Callable[..., Any]],
    status_code: int = 200,
) -> APIRouter:
    """Return a route for each message that the steps declare.

    Args:
        tag: Last part of the address before the name, and group in the document.
        kinds: Types of the messages by name.
        handler: Returns what answers the route of a type.
        status_code: Of an answer without a problem.
    """
    made = APIRouter(tags=[tag], route_class=BodyRoute)
    for name, kind in kinds.items():
        made.add_api_route(
            f"/sessions/{{session_id}}/{tag}/{name}",
            handler(kind),
            methods=["POST"],
            status_code=status_code,
            max_body_size=body_bytes(kind),
            name=name,
            operation_id=name,
            summary=(kind.__doc__ or name).splitlines()[0],
            description=kind.__doc__,
        )
    return made


def _command_handler(kind: type) -> Callable[..., Changed]:
    def send(bench: Bench, command: Any) -> Changed:
        return changed(bench, command)

    send.__annotations__["command"] = body_of(kind)
    return send


def declared_commands() -> APIRouter:
    """Return a route for each command that the steps declare."""
    return declared_routes("commands", REGISTRY.command_types, _command_handler)


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
