"""Sessions: make, list, open, save, download, upload, show, close; and files of specimens."""

from dataclasses import asdict, dataclass, fields
from typing import Annotated, Any, ClassVar, Literal
from urllib.parse import quote

from fastapi import APIRouter, Request, Response
from starlette.concurrency import run_in_threadpool

from rona_core.app.runtime.saving.session_files import FILE_NAME, MAX_UPLOAD_BYTES, export_recording
from rona_core.app.runtime.session_registry import SessionRegistry
from rona_core.app.runtime.workbench import Workbench
from rona_core.devices.limits import like, limited, require_limits
from rona_core.devices.settings import STRICT
from rona_core.errors import NotFoundError
from rona_core.session.document import TITLE, Setup
from rona_core.session.files import SUFFIX, session_bytes
from rona_ui.api.answers import plain
from rona_ui.api.bodies import RAW_BODY, BodyRoute, FileName, spooled
from rona_ui.api.context import (
    EXACT,
    PREFIX,
    Bench,
    SessionId,
    SessionInfo,
    Sessions,
    found,
    info,
    infos,
)
from rona_ui.resources import demo_session

router = APIRouter(route_class=BodyRoute, tags=["session"])
files = APIRouter(route_class=BodyRoute, tags=["files"])

SESSION_FILE = {**FILE_NAME, "maxLength": 120}
FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {"application/octet-stream": {}}, "description": "The file"}
}


@dataclass(frozen=True, slots=True)
class SessionList:
    """All open sessions, and the files that can be opened."""

    sessions: tuple[SessionInfo, ...]
    files: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class NewSession:
    """Name and seed of a session to be made."""

    __pydantic_config__: ClassVar = STRICT
    name: str = limited("untitled", **TITLE)
    seed: int = like(Setup, "seed")

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class FileToOpen:
    """Name of a file in the sessions folder, and whether its last good copy is opened instead."""

    __pydantic_config__: ClassVar = STRICT
    file: str = limited(**SESSION_FILE)
    backup: bool = False

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class FileToSave:
    """Name of the file to write; without one it goes where it came from.

    A file of that name that is not this session's, or that another program has changed meanwhile,
    is written over only where ``replace`` says so.
    """

    __pydantic_config__: ClassVar = STRICT
    file: str | None = limited(None, **SESSION_FILE)
    replace: bool = False

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class Uploaded:
    """A stored file, to be named in ``StartSkullImport`` and the other imports."""

    file: str
    size_bytes: int


def _made(hub: SessionRegistry, bench: Workbench, response: Response) -> SessionInfo:
    response.headers["Location"] = f"{PREFIX}/sessions/{bench.session.id}"
    return info(hub, bench)


@router.get("/sessions")
def list_sessions(hub: Sessions) -> SessionList:
    """List the open sessions and the files in the sessions folder."""
    return SessionList(infos(hub), tuple(path.name for path in hub.files.all()))


@router.post("/sessions", status_code=201)
def create_session(
    hub: Sessions, response: Response, new: Annotated[NewSession | None, EXACT] = None
) -> SessionInfo:
    """Make a new session; the viewer shows it."""
    wanted = new or NewSession()
    return _made(hub, hub.create(wanted.name.strip(), wanted.seed), response)


@router.post("/sessions/open", status_code=201)
def open_session(
    hub: Sessions, response: Response, wanted: Annotated[FileToOpen, EXACT]
) -> SessionInfo:
    """Open a file of the sessions folder; the viewer shows it.

    Where a file is damaged, the problem names its last good copy as `backup`, if there is one;
    `"backup": true` opens that, as a session that is not saved.
    """
    bench = hub.open_backup(wanted.file) if wanted.backup else hub.open_file(wanted.file)
    return _made(hub, bench, response)


@router.post("/sessions/demo", status_code=201)
def open_demo(hub: Sessions, response: Response) -> SessionInfo:
    """Open a copy of the demo session; the viewer shows it."""
    path = demo_session()
    if not path.is_file():
        raise NotFoundError("there is no demo session here; `make demo` shows the procedure")
    return _made(hub, hub.open_upload(path, path.name), response)


@files.post(
    "/sessions/upload", status_code=201, openapi_extra=RAW_BODY, max_body_size=MAX_UPLOAD_BYTES
)
async def upload_session(
    hub: Sessions, request: Request, response: Response, name: FileName = "upload.rona"
) -> SessionInfo:
    """Open the session file that is the body; the viewer shows it."""
    async with spooled(request, hub.files.uploads) as path:
        bench = await run_in_threadpool(hub.open_upload, path, name)
    return _made(hub, bench, response)


@router.get("/sessions/{session_id}")
def get_session(hub: Sessions, session_id: SessionId) -> dict[str, Any]:
    """Return a session in short, with its set-up, what it holds and what can be undone."""
    bench, short = found(hub, session_id)
    session = bench.session
    return {
        **asdict(short),
        "setup": {
            "seed": session.setup.seed,
            "specimen": _specimen(session.setup.specimen),
            "region": plain(session.setup.region),
            "devices": plain(session.setup.devices),
            "titles": session.setup.devices.titles(),
        },
        "captures": [
            {"kind": type(capture).__name__, "ordinal": capture.ordinal, "partial": capture.partial}
            for capture in session.archive
        ],
    }


def _specimen(specimen: Any) -> dict[str, Any]:
    """Return what describes a specimen, without its volume."""
    held = {field.name: getattr(specimen, field.name) for field in fields(specimen)}
    kept = {
        name: plain(value)
        for name, value in held.items()
        if value is None or isinstance(value, bool | int | float | str)
    }
    return {"kind": type(specimen).__name__, **kept}


@router.delete("/sessions/{session_id}", status_code=204)
def close_session(hub: Sessions, bench: Bench) -> None:
    """Close a session; what was not saved is gone, its file stays."""
    hub.close(bench.session.id)


@router.post("/sessions/{session_id}/current")
def show_session(hub: Sessions, bench: Bench) -> SessionInfo:
    """Show a session in the viewer."""
    return info(hub, hub.make_current(bench.session.id))


@files.post("/sessions/{session_id}/save")
def save_session(
    hub: Sessions, bench: Bench, wanted: Annotated[FileToSave | None, EXACT] = None
) -> SessionInfo:
    """Write a session to the sessions folder."""
    to = wanted or FileToSave()
    hub.save(bench.session.id, to.file, replace=to.replace)
    return info(hub, bench)


@router.post("/sessions/{session_id}/reload", status_code=201)
def reload_session(hub: Sessions, bench: Bench, response: Response) -> SessionInfo:
    """Open the file of a session anew in its place; what is not in the file is gone."""
    return _made(hub, hub.reload(bench.session.id), response)


def _download(name: str, data: bytes) -> Response:
    headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name, safe='')}"}
    return Response(data, media_type="application/octet-stream", headers=headers)


@files.get("/sessions/{session_id}/file", response_class=Response, responses=FILE)
def download_session(bench: Bench) -> Response:
    """Download the session file, as it would be saved now."""
    return _download(f"{bench.session.name}{SUFFIX}", session_bytes(bench.session))


@files.get(
    "/sessions/{session_id}/captures/{ordinal}/file", response_class=Response, responses=FILE
)
def download_capture(
    bench: Bench, ordinal: int, format: Literal["igs.mha"] = "igs.mha"
) -> Response:
    """Download what the tracker saw in a capture as a sequence file, which PLUS and Slicer read."""
    made = export_recording(bench.session, ordinal)
    return _download(made.name, made.data)


@files.post(
    "/sessions/{session_id}/uploads",
    status_code=201,
    openapi_extra=RAW_BODY,
    max_body_size=MAX_UPLOAD_BYTES,
)
async def upload_specimen(
    hub: Sessions, bench: Bench, request: Request, name: FileName
) -> Uploaded:
    """Store the body as a file for an import.

    A mask, CT volume or mesh for `StartSkullImport`, a recording for `StartRecordingImport`, the
    poses of a pivot or the markers of a tool for `StartPivotImport`, a reference for
    `StartComparison`.
    """
    async with spooled(request, hub.files.uploads) as body:
        size_bytes = body.stat().st_size
        path = await run_in_threadpool(hub.files.keep_upload, name, body)
    return Uploaded(path.name, size_bytes)
