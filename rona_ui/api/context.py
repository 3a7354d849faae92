"""What routes are given: session registry, open session, devices; sessions in short."""

from contextlib import suppress
from dataclasses import dataclass, is_dataclass
from functools import partial
from itertools import islice
from typing import Annotated, Any, LiteralString, cast
from weakref import WeakKeyDictionary

from fastapi import Depends, Path, Request
from pydantic import GetCoreSchemaHandler, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError, core_schema

from rona_core.app.messages.message import misfits
from rona_core.app.runtime.saving.autosave import CopyState
from rona_core.app.runtime.saving.session_files import FileState
from rona_core.app.runtime.session_registry import SessionRegistry
from rona_core.app.runtime.workbench import Workbench
from rona_core.devices.protocols import Rig
from rona_core.errors import DeviceError, NotFoundError, RonaError
from rona_ui.api.problems import MOST_ERRORS
from rona_ui.api.streams import Streams

TRIES = 3  # to find a session that is not closed meanwhile


@dataclass(frozen=True, slots=True)
class SessionInfo:
    """An open session in short."""

    id: str
    name: str
    revision: int  # how many messages have changed it
    current: bool  # whether the viewer shows it
    saved: bool  # whether its file holds it as it is now
    changes: bool  # whether closing it as it is now would lose something
    recovered: bool  # whether it was recovered after a crash, and not saved since
    can_undo: bool
    can_redo: bool
    copy: CopyState  # whether a copy is kept of what is not saved
    file: str | None
    file_state: FileState  # changed or missing: since it was opened or saved, by another program
    seed: int
    created_utc: str


def info(hub: SessionRegistry, bench: Workbench) -> SessionInfo:
    """Return an open session in short."""
    session = bench.session
    path = hub.file(session.id)
    return SessionInfo(
        id=session.id,
        name=session.name,
        revision=len(session.log),
        current=hub.is_current(session.id),
        saved=hub.is_saved(session.id),
        changes=hub.has_changes(session.id),
        recovered=hub.is_recovered(session.id),
        can_undo=bench.store.can_undo,
        can_redo=bench.store.can_redo,
        copy=hub.copy_state(session.id),
        file=None if path is None else path.name,
        file_state=hub.file_state(session.id),
        seed=session.setup.seed,
        created_utc=session.created_utc,
    )


def found(hub: SessionRegistry, session_id: str) -> tuple[Workbench, SessionInfo]:
    """Return the open session of an id, and it in short.

    Another one is current at once where the current one is closed while we look.

    Raises:
        NotFoundError: it is not open.
    """
    for _ in range(TRIES):
        bench = hub.get(session_id)
        with suppress(NotFoundError):  # closed meanwhile: asked by its own id, it is not found now
            return bench, info(hub, bench)
    raise NotFoundError(f"the session {session_id} is being closed")


def infos(hub: SessionRegistry) -> tuple[SessionInfo, ...]:
    """Return all open sessions in short, oldest first."""
    found: list[SessionInfo] = []
    for bench in hub.all():
        with suppress(NotFoundError):  # closed meanwhile
            found.append(info(hub, bench))
    return tuple(found)


PREFIX = "/api/v1"


class Exact:
    """Marks a body whose values must have the types of their fields, nothing taken for another."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Look at the body before pydantic makes a value of it."""
        return core_schema.no_info_before_validator_function(
            partial(_require_fitting, source), handler(source)
        )


def _require_fitting(kind: Any, body: Any) -> Any:
    """Return a body unless ``misfits`` finds something; then its first entry is the refusal.

    A dataclass has been looked at already, in a thread (``BodyRoute``).
    """
    if is_dataclass(body):
        return body
    wrong = [
        InitErrorDetails(
            type=PydanticCustomError(
                cast("LiteralString", found.code),
                "expected {expected}",
                {"expected": found.expected},
            ),
            loc=found.path,
            input=None,
        )
        for found in islice(misfits(body, kind), MOST_ERRORS + 1)
    ]
    if wrong:
        raise ValidationError.from_exception_data("body", wrong)
    return body


EXACT = Exact()


async def hub_of(request: Request) -> SessionRegistry:
    """Return the hub of the application."""
    return request.app.state.hub


async def streams_of(request: Request) -> Streams:
    """Return the open event streams of the application."""
    return request.app.state.streams


Sessions = Annotated[SessionRegistry, Depends(hub_of)]
Open = Annotated[Streams, Depends(streams_of)]


SessionId = Annotated[
    str, Path(description="id of an open session, or `current` for the one the viewer shows")
]


async def bench_of(hub: Sessions, session_id: SessionId) -> Workbench:
    """Return the workbench that the address names."""
    return hub.get(session_id)


Bench = Annotated[Workbench, Depends(bench_of)]


def idle_rig(bench: Workbench) -> Rig:
    """Return the devices unless a job uses them.

    Raises:
        DeviceError: they are busy.
    """
    if bench.jobs.devices_busy:
        raise DeviceError("the devices are busy with a job: wait for it or cancel it")
    return bench.rig()


_ORIGINS: WeakKeyDictionary[Workbench, str] = WeakKeyDictionary()


def origin_of(bench: Workbench) -> str | None:
    """Return VIRTUAL, REPLAY or REAL, or None where the devices cannot be built.

    It is REPLAY while a recording is played, whatever the devices are.
    """
    playing = bench.live.get().origin
    if playing is not None:
        return playing
    if bench not in _ORIGINS:
        try:
            _ORIGINS[bench] = bench.rig().origin
        except RonaError:
            return None
    return _ORIGINS[bench]
