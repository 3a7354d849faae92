"""The web server: one process, one port, one origin for the page, the viewer and REST."""

import asyncio
import contextlib
import os
import re
import secrets
import shutil
import socket
import threading
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import uvicorn
import viser
from fastapi import APIRouter, FastAPI
from fastapi.staticfiles import StaticFiles
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from rona_core import __version__
from rona_core.app.runtime.session_registry import SessionRegistry
from rona_core.errors import InvalidInputError
from rona_ui.api import problems
from rona_ui.api.access_guard import LOOPBACK, Access, Guard, is_loopback
from rona_ui.api.answers import FastJson, InPieces
from rona_ui.api.bodies import AT_ONCE, BODY_BYTES, add_limits
from rona_ui.api.context import PREFIX
from rona_ui.api.routes import (
    calibrations,
    devices,
    events,
    figures,
    files,
    jobs,
    procedure,
    results,
    sessions,
)
from rona_ui.api.streams import Streams
from rona_ui.api.timed_protocol import TimedProtocol
from rona_ui.resources import cookie_secret, sessions_dir, static_dir
from rona_ui.viewer.gateway import MAX_MESSAGE_BYTES, ViewerGateway

GRACE_S = 1  # for requests under way when the server ends
PORT = 8642
SESSION_PAGE = "/session"
ROOT_PATH = re.compile(r"(?!/(api|session|static|viewer)(/|$))(/[A-Za-z0-9_~-][A-Za-z0-9._~-]*)+")
TAGS = {
    "session": "Open sessions and their changes. `current` stands for the one the viewer shows.",
    "files": "Session files and files of specimens.",
    "procedure": "Stages of the procedure: what is done, and what to do now.",
    "commands": "Changes of a session, at once and purely; one route per command.",
    "jobs": "What takes time or touches a device: started, followed, cancelled.",
    "results": "What a session knows: steps, results, frames, figures, replay.",
    "tracker": "The optical tracking system.",
    "robot": "The robot. Stop wins over everything.",
    "probe": "The ultrasound probe.",
    "operator": "The hand that holds the pointer.",
}
CONTENT_POLICY = "; ".join(
    (
        "default-src 'self'",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data:",
        "frame-ancestors 'self'",
        "base-uri 'none'",
        "form-action 'self'",
    )
)


class Window(Protocol):
    """What is drawn in the viewer."""

    def close(self) -> None:
        """Stop drawing."""
        ...


OpenWindow = Callable[[viser.ViserServer, SessionRegistry], Window]


@dataclass(frozen=True, slots=True)
class ServerSettings:
    """How to serve.

    Raises:
        InvalidInputError: without a token the server may be bound to this machine only.
    """

    host: str = "127.0.0.1"
    port: int = PORT  # 0 takes a free one
    sessions: Path = field(default_factory=sessions_dir)
    allow_hosts: tuple[str, ...] = ()
    token: str | None = field(default_factory=lambda: token_from_environment())
    open_browser: bool = True
    file: Path | None = None  # session file to open first; None begins with the list of them
    root_path: str = ""  # sub path of a reverse proxy: empty, or /name without a slash at its end

    def __post_init__(self) -> None:
        if self.token is None and not is_loopback(self.host):
            raise InvalidInputError(
                f"--no-auth works on this machine only, not when bound to {self.host}: "
                "leave it out or bind to 127.0.0.1"
            )
        if not 0 <= self.port <= 65535:
            raise InvalidInputError(f"port must be 0 to 65535, not {self.port}")
        if self.root_path and not ROOT_PATH.fullmatch(self.root_path):
            raise InvalidInputError(
                f"--root-path must be the sub path of the proxy, such as /rona, and not begin with "
                f"/api, /session, /static or /viewer; got {self.root_path[:60]!r}"
            )

    @property
    def access(self) -> Access:
        """Names the server answers to, and the token it wants."""
        wildcard = self.host in ("0.0.0.0", "::", "")
        bound = () if wildcard else (self.host,)
        hosts = (*LOOPBACK, *bound, *self.allow_hosts)
        return Access(self.token, hosts, self.root_path)


def token_from_environment() -> str:
    """Return ``RONA_TOKEN``, or a random token where it is not set."""
    return os.environ.get("RONA_TOKEN") or secrets.token_urlsafe(24)


def bare_app(hub: SessionRegistry, gateway: ViewerGateway | None, root_path: str = "") -> FastAPI:
    """Return the application of one hub, page, viewer and REST, without its guard.

    Its description says that its addresses are below ``root_path``; the guard has them there.
    """
    app = FastAPI(
        title="RONA",
        version=__version__,
        summary="Plan, rehearse and evaluate a robot-held ultrasound scan of the skull.",
        description=f"{events.NOTICE.capitalize()}. Lengths are mm; names carry their unit.",
        openapi_url=None,  # `_add_pages` has a route of its own, which answers from a thread
        docs_url=None,
        redoc_url=None,
        servers=[{"url": root_path}] if root_path else None,
        openapi_tags=[{"name": name, "description": text} for name, text in TAGS.items()],
        max_body_size=BODY_BYTES,
    )
    app.add_middleware(InPieces)
    app.state.hub = hub
    app.state.streams = Streams()
    app.state.turns = asyncio.Semaphore(AT_ONCE)
    app.state.drawing = asyncio.Semaphore(1)
    problems.install(app)
    _add_pages(app)  # before the interface: FastAPI prepares a route when it is first passed
    if gateway is not None:
        app.router.routes.extend(gateway.routes())
    parts = (sessions, files, procedure, jobs, results, calibrations, figures, events)
    held = (devices.tracker_router, devices.robot_router, devices.probe_router)
    held += (devices.operator_router, jobs.commands_router)
    declared = (jobs.declared_commands(), jobs.declared_jobs())
    routers = (*(part.router for part in parts), *held, sessions.files, *declared)
    for router in routers:
        app.include_router(router, prefix=PREFIX, responses=problems.RESPONSES)
    _describe(app, routers)
    return app


def _add_pages(app: FastAPI) -> None:
    folder = static_dir()

    def page(name: str) -> Callable[[Request], Response]:
        headers = {"Content-Security-Policy": CONTENT_POLICY, "Cache-Control": "no-cache"}
        return lambda request: FileResponse(folder / name, headers=headers)

    for path, name in (
        ("/", "index.html"),
        (SESSION_PAGE, "index.html"),  # the same page, with the open session in sight
        (f"{PREFIX}/docs", "docs.html"),
    ):
        app.router.routes.append(Route(path, page(name), methods=["GET", "HEAD"]))
    icon = page("icon.svg")
    app.router.routes.append(Route("/favicon.ico", icon, methods=["GET", "HEAD"]))

    def document(request: Request) -> Response:
        return FastJson(app.openapi())

    app.router.routes.append(Route(f"{PREFIX}/openapi.json", document))
    app.mount("/static", StaticFiles(directory=folder), name="static")


def _describe(app: FastAPI, routers: Sequence[APIRouter]) -> None:
    """Add limits of fields, the problem and the token to the OpenAPI document."""
    generate = app.openapi
    lock = threading.Lock()  # it is made in threads, and once

    def openapi() -> dict[str, Any]:
        with lock:
            return described()

    def described() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = generate()
            add_limits(document, routers)
            for verbs in document["paths"].values():
                for operation in verbs.values():
                    first = operation.get("description", "").splitlines()
                    operation["summary"] = first[0] if first else operation["summary"]
            parts = document.setdefault("components", {})
            parts.setdefault("schemas", {})["Problem"] = problems.SCHEMA
            for unused in ("HTTPValidationError", "ValidationError"):
                parts["schemas"].pop(unused, None)
            parts["securitySchemes"] = {
                "token": {"type": "http", "scheme": "bearer", "description": "RONA_TOKEN"}
            }
            document["security"] = [{"token": []}]
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = openapi  # FastAPI's documented way to extend the document


class Server(uvicorn.Server):
    """uvicorn that ends the event streams first, so that it need not wait for them."""

    def __init__(self, app: ASGIApp, streams: Streams, settings: ServerSettings) -> None:
        """Serve ``app``."""
        self._streams = streams
        super().__init__(
            uvicorn.Config(
                app,
                host=settings.host,
                port=settings.port,
                log_level="warning",
                access_log=False,
                server_header=False,
                http=TimedProtocol,
                ws="websockets-sansio",
                ws_max_size=MAX_MESSAGE_BYTES,
                ws_per_message_deflate=False,
                timeout_graceful_shutdown=GRACE_S,
            )
        )

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the streams, then everything else."""
        self._streams.close()
        await asyncio.sleep(0)
        await super().shutdown(sockets)


def server_of(
    hub: SessionRegistry, gateway: ViewerGateway | None, settings: ServerSettings
) -> Server:
    """Return a server that is ready to run."""
    app = bare_app(hub, gateway, settings.root_path)
    return Server(
        Guard(app, settings.access, cookie_secret(settings.sessions)), app.state.streams, settings
    )


def address(settings: ServerSettings, port: int) -> str:
    """Return the address to open, with the token: that of the session where a file is opened."""
    host = settings.host if settings.host not in ("0.0.0.0", "::", "") else "127.0.0.1"
    host = f"[{host}]" if ":" in host else host
    query = "" if settings.token is None else f"?token={settings.token}"
    path = "/" if settings.file is None else SESSION_PAGE
    return f"http://{host}:{port}{settings.root_path}{path}{query}"


def has_display() -> bool:
    """Return whether a browser can be opened for the user."""
    if os.name == "nt" or shutil.which("open"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def serve(
    settings: ServerSettings,
    *,
    build_registry: Callable[[Path], SessionRegistry],
    open_window: OpenWindow,
    say: Callable[[str], None],
) -> None:
    """Serve until interrupted; ``say`` receives the address.

    Raises:
        InvalidInputError: the port is taken or the host is not one of this machine.
    """
    bound = _bind(settings)
    with contextlib.ExitStack() as ends, bound:
        hub = build_registry(settings.sessions)
        ends.callback(hub.close_all)
        if settings.file is not None:
            hub.open_path(settings.file)
        gateway = ViewerGateway()
        ends.callback(gateway.close)
        server = server_of(hub, gateway, settings)
        window = open_window(gateway.server, hub)  # last: it computes beside what comes after
        ends.callback(window.close)
        url = address(settings, bound.getsockname()[1])
        say(url)
        if settings.open_browser and has_display():
            webbrowser.open(url)
        server.run(sockets=[bound])


def _bind(settings: ServerSettings) -> socket.socket:
    host = settings.host
    try:
        # who comes before the server is ready waits instead of failing
        return socket.create_server(
            (host, settings.port),
            family=socket.AF_INET6 if ":" in host else socket.AF_INET,
            backlog=128,
            dualstack_ipv6=host == "::" and socket.has_dualstack_ipv6(),
        )
    except OSError as error:
        reason = error.strerror or str(error)
        raise InvalidInputError(
            f"cannot listen on {settings.host}, port {settings.port}: {reason}; try another --port"
        ) from error
