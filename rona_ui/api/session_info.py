"""Open sessions in short, also while one of them is being closed."""

from contextlib import suppress
from dataclasses import dataclass

from rona_core.app.runtime.saving.autosave import CopyState
from rona_core.app.runtime.saving.session_files import FileState
from rona_core.app.runtime.session_registry import SessionRegistry
from rona_core.app.runtime.workbench import Workbench
from rona_core.errors import NotFoundError

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
