"""viser behind our own origin: the one file that knows its inside.

viser 1.1 runs a websocket server of its own, without any check of who connects. Here it listens on
a free loopback port and refuses everybody who does not know a secret that never leaves this
process; the browser reaches it through a relay on our port, behind the guard of the application.
"""

import asyncio
import contextlib
import functools
import gzip
import hashlib
import hmac
import http
import io
import secrets
import threading
import zipfile
from collections.abc import Generator
from importlib import import_module
from pathlib import Path
from typing import Any

import rich
import viser
import websockets.asyncio.client
import websockets.asyncio.server
import websockets.exceptions
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.typing import Subprotocol

from rona_core.errors import DeviceError

TESTED = ("1.1.1",)  # versions of viser that the contract test was run with
PAGE_POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'nonce-{nonce}' 'unsafe-eval'",  # a part of it in WebAssembly makes functions
        "worker-src blob: data:",
        "connect-src 'self' blob: data:",
        "style-src 'unsafe-inline'",  # its framework writes styles
        "img-src 'self' blob: data:",
        "media-src blob: data:",
        "font-src data:",
        "frame-ancestors 'self'",
        "base-uri 'none'",
        "form-action 'none'",
    )
)
SECRET_HEADER = "X-Rona-Gateway"
MAX_MESSAGE_BYTES = 64 * 1024**2
FIRST_MESSAGE_S = 4.0  # from the connection to what the page sends by itself: its camera
_construction = threading.Lock()  # while viser starts, its call to websockets is intercepted


class ViewerGateway:
    """Holds a viser server and hands its page and its messages on."""

    def __init__(self) -> None:
        """Start viser on a free loopback port."""
        self._secret = secrets.token_hex(32)
        _keep_icons_open()
        self.server = _start_viser(self._secret)
        self._uri = f"ws://127.0.0.1:{self.server.get_port()}"
        nonce = secrets.token_urlsafe(18)
        page = _page_with(nonce)
        self._page = page
        self._policy = PAGE_POLICY.format(nonce=nonce)
        self._zipped = gzip.compress(page, 6, mtime=0)
        self._etag = f'"{hashlib.sha256(page).hexdigest()[:32]}"'

    @property
    def port(self) -> int:
        """The loopback port that viser listens on."""
        return self.server.get_port()

    def close(self) -> None:
        """Stop viser; a second call does nothing."""
        with _quiet():
            self.server.stop()

    def routes(self, prefix: str = "/viewer") -> list[BaseRoute]:
        """Return the routes of the page and of the relay under ``prefix``."""
        return [
            Route(f"{prefix}/", self._serve_page, methods=["GET", "HEAD"]),
            Route(prefix, functools.partial(_redirect, f"{prefix}/"), methods=["GET"]),
            WebSocketRoute(prefix, self._relay),
            WebSocketRoute(f"{prefix}/", self._relay),
        ]

    async def _serve_page(self, request: Request) -> Response:
        headers = {
            "ETag": self._etag,
            "Cache-Control": "no-cache",
            "Content-Security-Policy": self._policy,
            "Vary": "Accept-Encoding",
            "X-Content-Type-Options": "nosniff",
        }
        known = [tag.strip() for tag in request.headers.get("if-none-match", "").split(",")]
        if self._etag in known or "*" in known:
            return Response(status_code=304, headers=headers)
        body = self._page
        if "gzip" in request.headers.get("accept-encoding", ""):
            body, headers["Content-Encoding"] = self._zipped, "gzip"
        return Response(body, media_type="text/html", headers=headers)

    async def _relay(self, browser: WebSocket) -> None:
        """Hand messages on in both directions until one side goes away."""
        offered = browser.scope.get("subprotocols", [])
        protocol = next((p for p in offered if p.startswith("viser-v")), None)
        if protocol is None:
            await browser.close(1002, "expected the viewer's page to connect")
            return
        try:
            async with websockets.asyncio.client.connect(
                self._uri,
                subprotocols=[Subprotocol(protocol)],
                additional_headers={SECRET_HEADER: self._secret},
                compression=None,
                max_size=None,
                ping_interval=None,
                proxy=None,
            ) as upstream:
                await browser.accept(subprotocol=protocol)
                await _first_to_end(_pump_up(browser, upstream), _pump_down(upstream, browser))
        except (OSError, websockets.exceptions.WebSocketException):
            pass  # viser is stopping: the browser tries again by itself
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # it may be gone
            await browser.close(1001)


async def _redirect(to: str, request: Request) -> Response:
    return RedirectResponse(to)


async def _pump_up(browser: WebSocket, upstream: Any) -> None:
    """Hand on what the page sends; end where it says nothing at first.

    Where its frame gets the focus while it connects, viser 1.1 connects twice and sends its camera
    to the connection that it has given up. Nothing is drawn on the other one before a camera
    comes, so that has to end: the page then connects once more.
    """
    message = await asyncio.wait_for(browser.receive(), FIRST_MESSAGE_S)
    while message["type"] != "websocket.disconnect":
        data = message.get("bytes")
        await upstream.send(data if data is not None else message["text"])
        message = await browser.receive()


async def _pump_down(upstream: Any, browser: WebSocket) -> None:
    async for data in upstream:
        if isinstance(data, str):
            await browser.send_text(data)
        else:
            await browser.send_bytes(data)


async def _first_to_end(*jobs: Any) -> None:
    tasks = [asyncio.ensure_future(job) for job in jobs]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        ends = await asyncio.gather(*tasks, return_exceptions=True)
    lost = (
        asyncio.CancelledError,
        OSError,
        RuntimeError,  # a send after the browser went away
        WebSocketDisconnect,
        websockets.exceptions.WebSocketException,
    )
    for end in ends:
        if isinstance(end, BaseException) and not isinstance(end, lost):
            raise end


# ------------------------------------------------------------------ the seam


def _start_viser(secret: str) -> viser.ViserServer:
    """Return a viser server that only answers who sends ``secret``, and that cannot be shared."""
    captured: list[bool] = []
    genuine = websockets.asyncio.server.serve

    def guarded(handler: Any, *args: Any, process_request: Any = None, **rest: Any) -> Any:
        captured.append(True)

        def check(connection: Any, request: Any) -> Any:
            sent = request.headers.get(SECRET_HEADER, "")
            if not hmac.compare_digest(sent.encode(), secret.encode()):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "not the way in\n")
            return None if process_request is None else process_request(connection, request)

        return genuine(handler, *args, process_request=check, **rest)

    with _construction, _quiet():
        websockets.asyncio.server.serve = guarded  # type: ignore[assignment, misc]
        try:
            server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        finally:
            websockets.asyncio.server.serve = genuine  # type: ignore[misc]
    if not captured:
        server.stop()
        raise DeviceError(
            f"the viewer could not be closed to strangers: viser {viser.__version__} starts its "
            f"server in another way than {', '.join(TESTED)}; install one of these"
        )
    server.request_share_url = _refuse_sharing
    return server


def _page_with(nonce: str) -> bytes:
    """Return viser's page whose two scripts carry ``nonce``: that in it, and what that unpacks.

    Raises:
        DeviceError: the page is made in another way than that of the versions tested.
    """
    page = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
    for script, also in ((b"<script ", b'nonce="%s" '), (b'e.type="module";', b'e.nonce="%s";')):
        if page.count(script) != 1:
            raise DeviceError(
                f"the viewer's page could not be restricted to its own scripts: that of viser "
                f"{viser.__version__} is made in another way than {', '.join(TESTED)}; install one "
                "of these"
            )
        page = page.replace(script, script + also % nonce.encode())
    return page


def _keep_icons_open() -> None:
    """Have viser read its icons from an archive that stays open.

    It opens it for each icon, and to read its list of 4285 takes longer than to draw a panel.
    """
    archive = zipfile.ZipFile(Path(viser.__file__).parent / "_icons" / "tabler-icons.zip")

    @functools.cache
    def svg_from_icon(name: str) -> str:
        return archive.read(f"{name}.svg").decode()

    for user in ("_gui_api", "_gui_handles"):
        module: Any = import_module(f"viser.{user}")
        module.svg_from_icon = svg_from_icon


def uuid_of(handle: Any) -> str:
    """Return the name by which page and server mean the same widget; its label points to it."""
    return handle._impl.uuid  # noqa: SLF001


def _refuse_sharing(*_: Any, **__: Any) -> None:
    """Take the place of viser's public tunnel, which would lead round every check."""


@contextlib.contextmanager
def _quiet() -> Generator[None]:
    """Swallow viser's banner, which prints an address that cannot be used."""
    genuine = rich.print
    rich.print = functools.partial(genuine, file=io.StringIO())
    try:
        yield
    finally:
        rich.print = genuine
