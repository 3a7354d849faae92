"""Recovery: list, open and discard unsaved sessions of an earlier run."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Path, Response

from rona_core.app.runtime.saving.autosave import LostSession
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import PREFIX, Sessions
from rona_ui.api.session_info import SessionInfo, info

router = APIRouter(route_class=BodyRoute, tags=["files"])
Key = Annotated[str, Path(max_length=100, description="key of an unsaved session, from the list")]


@dataclass(frozen=True, slots=True)
class LostSessions:
    """Sessions that were not saved when their program ended, the newest first."""

    recoverable: tuple[LostSession, ...]


@dataclass(frozen=True, slots=True)
class Recovered:
    """A session that is open again, and not saved yet."""

    session: SessionInfo
    problem: str | None  # what of it could not be recovered; then its copy stays in the list


@router.get("/recoverable")
def list_recoverable(hub: Sessions) -> LostSessions:
    """List the sessions that were not saved when their program ended."""
    return LostSessions(hub.lost())


@router.post("/recoverable/{key}/open", status_code=201)
def recover_session(hub: Sessions, response: Response, key: Key) -> Recovered:
    """Open an unsaved session of an earlier run; the viewer shows it."""
    bench, problem = hub.recover(key)
    response.headers["Location"] = f"{PREFIX}/sessions/{bench.session.id}"
    return Recovered(info(hub, bench), problem)


@router.delete("/recoverable/{key}", status_code=204)
def discard_session(hub: Sessions, key: Key) -> None:
    """Remove an unsaved session of an earlier run for good."""
    hub.discard(key)
