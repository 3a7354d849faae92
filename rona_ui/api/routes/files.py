"""Session files that can be opened, their pictures, and sessions left unsaved."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Request, Response
from fastapi import Path as InPath
from starlette.concurrency import run_in_threadpool

from rona_core.app.runtime.saving.autosave import LostSession
from rona_core.app.runtime.saving.session_files import plain_name
from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.session.files import write_whole
from rona_ui.api.bodies import RAW_BODY, BodyRoute
from rona_ui.api.context import PREFIX, Bench, SessionInfo, Sessions, info

router = APIRouter(route_class=BodyRoute, tags=["files"])
MAX_PICTURE_BYTES = 200 * 1024
JPEG_BEGIN = b"\xff\xd8\xff"
PICTURES = ".pictures"  # folder beside the session files
JPEG: dict[int | str, dict[str, Any]] = {
    200: {"content": {"image/jpeg": {}}, "description": "The picture"}
}
File = Annotated[str, InPath(max_length=120, description="plain name of a session file")]


@dataclass(frozen=True, slots=True)
class SavedFile:
    """A session file."""

    file: str
    changed_utc: str
    size_bytes: int
    picture: bool  # whether there is one of the session as it was saved last


@dataclass(frozen=True, slots=True)
class SavedFiles:
    """Session files, the newest first."""

    files: tuple[SavedFile, ...]


def _picture(folder: Path, file: str) -> Path:
    return folder / PICTURES / f"{plain_name(file)}.jpg"


def _has_picture(path: Path) -> bool:
    """Return whether a session file has a picture that was taken since it was written."""
    picture = _picture(path.parent, path.name)
    return picture.is_file() and picture.stat().st_mtime_ns >= path.stat().st_mtime_ns


@router.get("/files")
def list_files(hub: Sessions) -> SavedFiles:
    """List the session files, the newest first."""
    found: list[tuple[float, SavedFile]] = []
    for path in hub.files.all():
        try:
            held = path.stat()
            picture = _has_picture(path)
        except FileNotFoundError:
            continue  # removed meanwhile
        changed = datetime.fromtimestamp(held.st_mtime, UTC).isoformat(timespec="seconds")
        found.append((held.st_mtime, SavedFile(path.name, changed, held.st_size, picture)))
    found.sort(key=lambda entry: entry[0], reverse=True)
    return SavedFiles(tuple(entry for _, entry in found))


@router.get("/files/{file}/picture", response_class=Response, responses=JPEG)
def get_picture(hub: Sessions, file: File) -> Response:
    """Return the picture of a session file as it was saved last (JPEG)."""
    path = hub.files.folder / plain_name(file)
    if not path.is_file() or not _has_picture(path):
        raise NotFoundError(f"there is no picture of {file} as it was saved last")
    data = _picture(hub.files.folder, file).read_bytes()
    return Response(data, media_type="image/jpeg", headers={"Cache-Control": "no-cache"})


@router.put(
    "/sessions/{session_id}/picture",
    status_code=204,
    openapi_extra=RAW_BODY,
    max_body_size=MAX_PICTURE_BYTES,
)
async def keep_picture(hub: Sessions, bench: Bench, request: Request) -> None:
    """Keep the body, a small JPEG picture, beside the file of a saved session.

    The page sends what its scene shows when a session has been saved.
    """
    data = await request.body()
    if not data.startswith(JPEG_BEGIN):
        raise InvalidInputError("expected a JPEG picture as the body")
    file = hub.file(bench.session.id)
    if file is None or not hub.is_saved(bench.session.id):
        raise InvalidInputError("the session is not saved: a picture belongs to a file")
    await run_in_threadpool(write_whole, _picture(hub.files.folder, file.name), data)


Key = Annotated[str, InPath(max_length=100, description="key of an unsaved session, from the list")]


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
