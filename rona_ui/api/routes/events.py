"""Event streams: the log of a session and the state of the program."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import ExitStack
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query
from starlette.concurrency import run_in_threadpool

from rona_core import __version__
from rona_core.app.runtime.session_registry import CURRENT, SessionRegistry
from rona_core.app.runtime.workbench import Workbench
from rona_core.errors import NotFoundError
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import Bench, Open, Sessions, found, infos, origin_of
from rona_ui.api.routes.jobs import job_info
from rona_ui.api.streams import ALIVE, DESCRIBED, EventStream, Streams, event
from rona_ui.labels import doing

router = APIRouter(route_class=BodyRoute, tags=["session"])
NOTICE = "research software, not a medical device"
QUICK_S = 0.25  # the least time between two states of the program


@router.get("/sessions/{session_id}/events", response_class=EventStream, responses=DESCRIBED)
async def session_events(
    bench: Bench,
    hub: Sessions,
    streams: Open,
    since: Annotated[
        int | None, Query(ge=0, description="first the changes after this revision; 0 for all")
    ] = None,
    last_event_id: Annotated[str | None, Header(include_in_schema=False)] = None,
) -> EventStream:
    """Follow the changes of a session: one `change` event per revision; `closed` at its end."""
    seen = bench.store.revision if since is None else since
    if last_event_id is not None and last_event_id.isdecimal() and len(last_event_id) < 10:
        seen = int(last_event_id)
    return EventStream(_changes(hub, bench, seen, streams))


async def _changes(
    hub: SessionRegistry, bench: Workbench, seen: int, streams: Streams
) -> AsyncIterator[bytes]:
    with streams.waker(bench.store.subscribe, hub.subscribe) as waker:
        while not streams.closing:
            log = bench.session.log
            for entry in log[seen:]:
                data = {
                    "revision": entry.number,
                    "message": entry.message,
                    "arguments": entry.arguments,
                    "time_utc": entry.time_utc,
                }
                yield event(data, kind="change", number=entry.number)
            seen = max(seen, len(log))
            if bench.closed:
                yield event({"revision": seen}, kind="closed")
                return
            if not await waker.wait():
                yield ALIVE


def state_of(hub: SessionRegistry) -> dict[str, Any]:
    """Return the state of the program: the session that the viewer shows, and what runs in it.

    ``run`` is another one after each start of the program.
    """
    state: dict[str, Any] = {
        "program": "RONA",
        "version": __version__,
        "notice": NOTICE,
        "run": hub.run,
        "session": None,
        "sessions": [asdict(each) for each in infos(hub)],
        "recoverable": _count_lost(hub),
        "origin": None,
        "jobs": [],
    }
    try:
        bench, short = found(hub, CURRENT)
    except NotFoundError:
        return state
    state["session"] = asdict(short)
    state["origin"] = origin_of(bench)
    running = [status for status in bench.jobs.all() if not status.finished]
    state["jobs"] = [
        {**asdict(job_info(bench, status)), "words": doing(status.activity)} for status in running
    ]
    return state


def _count_lost(hub: SessionRegistry) -> int:
    try:
        return len(hub.lost_keys())
    except OSError:  # `GET /recoverable` says why; the state goes on
        return 0


@router.get("/status")
def get_status(hub: Sessions) -> dict[str, Any]:
    """Return the state of the program: version, current session, device origin, running jobs."""
    return state_of(hub)


@router.get("/status/events", response_class=EventStream, responses=DESCRIBED)
async def status_events(hub: Sessions, streams: Open) -> EventStream:
    """Follow the state of the program by server-sent events."""
    return EventStream(_states(hub, streams))


async def _states(hub: SessionRegistry, streams: Streams) -> AsyncIterator[bytes]:
    sent, followed = None, None
    with streams.waker(hub.subscribe) as waker, ExitStack() as subscriptions:
        while not streams.closing:
            try:
                bench = hub.get()
            except NotFoundError:
                bench = None
            if bench is not followed:
                followed = bench
                subscriptions.close()
                for source in () if bench is None else (bench.store, bench.jobs):
                    subscriptions.callback(source.subscribe(waker.wake))
            state = await run_in_threadpool(state_of, hub)
            if state != sent:
                sent = state
                yield event(state, kind="status")
                await asyncio.sleep(QUICK_S)
            if not await waker.wait():
                yield ALIVE
