"""Access guard: checks Host, Origin and token of every request.

It wraps the whole application, so that pages, REST and the viewer's websocket obey one rule. It
alone handles the sub path of a reverse proxy: the application inside has its addresses at the root.
"""

import hmac
import ipaddress
import secrets
from dataclasses import dataclass
from urllib.parse import parse_qsl, urlencode, urlsplit

from starlette.datastructures import Headers, QueryParams
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rona_ui.api.problems import MEDIA_TYPE, problem

LOOPBACK = ("localhost", "127.0.0.1", "::1")
KEEP_HOST = "a reverse proxy has to pass the Host header on as the browser sent it"
FOREIGN = (
    "requests from pages of other origins are refused: Origin has to be that of Host; " + KEEP_HOST
)
SAFE = ("GET", "HEAD", "OPTIONS")
HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-frame-options", b"SAMEORIGIN"),
    (b"content-security-policy", b"default-src 'none'; frame-ancestors 'self'"),  # pages say more
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


@dataclass(frozen=True, slots=True)
class Access:
    """Names the server answers to, and the token it wants; None lets everybody in.

    ``root_path`` is the path that a reverse proxy has it under: empty, or ``/name`` without a slash
    at its end.
    """

    token: str | None
    hosts: tuple[str, ...] = LOOPBACK
    root_path: str = ""


def is_loopback(host: str) -> bool:
    """Return whether a server bound to ``host`` can be reached from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Guard:
    """Lets a request through to ``app`` or answers it with a problem."""

    def __init__(self, app: ASGIApp, access: Access, secret: bytes | None = None) -> None:
        """Guard ``app``; cookies are made from ``secret``, None from one of this run."""
        self._app = app
        self._access = access
        self._hosts = {host.lower().strip("[]") for host in access.hosts}
        self._root = access.root_path
        secret = secret or secrets.token_bytes(32)
        # what the cookie carries: it ends with the token, and does not give it away
        self._session = hmac.new(secret, (access.token or "").encode(), "sha256").hexdigest()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check one request or websocket (ASGI)."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        send = _with_headers(send, self._root) if scope["type"] == "http" else send
        if refusal is None:
            await self._app(self._inside(scope), receive, send)
        elif scope["type"] == "http":
            await refusal(scope, receive, send)
        else:
            await receive()  # the request to connect; closing before accepting answers 403
            await send({"type": "websocket.close", "code": 1008, "reason": "refused"})

    def _inside(self, scope: Scope) -> Scope:
        """Return a request as the application has it; some proxies take the sub path off."""
        path, root = scope["path"], self._root
        if not root or not path.startswith(f"{root}/"):
            return scope
        raw = scope.get("raw_path", path.encode())
        return {**scope, "path": path[len(root) :], "raw_path": raw[len(root) :]}

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if _name(host) not in self._hosts:
            text = (
                f"this server is {', '.join(sorted(self._hosts))}, not {_name(host)[:80]!r}: "
                f"start it with --allow-host and the name in its address; {KEEP_HOST}"
            )
            return problem(421, text)
        origin = headers.get("origin")
        websocket = scope["type"] == "websocket"
        if origin is not None and (websocket or scope["method"] not in SAFE):
            if origin.lower() not in (f"http://{host}".lower(), f"https://{host}".lower()):
                return problem(403, FOREIGN)
        site = headers.get("sec-fetch-site", "none").lower()  # which site's page asks for it
        if site not in ("none", "same-origin") and not websocket and scope["method"] not in SAFE:
            return problem(403, FOREIGN)
        if self._root and scope["path"] == self._root and not websocket:
            query = scope["query_string"].decode("latin-1")  # pages are relative to their folder
            return RedirectResponse(f"/?{query}" if query else "/", status_code=308)
        if self._access.token is None:
            return None
        return self._unless_known(scope, headers)

    def _unless_known(self, scope: Scope, headers: Headers) -> Response | None:
        """Return None for a request with the token; with it in the address it gets a cookie."""
        if scope["type"] == "http" and scope["method"] in SAFE:
            brought = QueryParams(scope["query_string"]).get("token")
            if brought is not None and self._is_token(brought):
                return self._welcome(scope)
        scheme, _, value = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            known = self._is_token(value.strip())
        else:
            known = any(
                hmac.compare_digest(value.encode(), self._session.encode())
                for value in _cookies(headers, cookie_name(scope))
            )
        if known:
            return None
        text = (
            "open the address that rona serve printed, or send the header "
            "'Authorization: Bearer TOKEN'"
        )
        return problem(401, text, headers={"WWW-Authenticate": "Bearer"})

    def _is_token(self, given: str) -> bool:
        wanted = self._access.token or ""
        return hmac.compare_digest(given.encode(), wanted.encode())

    def _welcome(self, scope: Scope) -> Response:
        """Set the cookie and lead to the same address without the token."""
        query = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)
        rest = urlencode([(key, value) for key, value in query if key != "token"])
        path = "/" + self._inside(scope)["path"].lstrip("/")  # never //elsewhere
        response = RedirectResponse(f"{path}?{rest}" if rest else path, status_code=303)
        response.set_cookie(
            cookie_name(scope),
            self._session,
            httponly=True,
            samesite="strict",
            path=f"{self._root}/",
        )
        response.headers["Cache-Control"] = "no-store"
        return response


def cookie_name(scope: Scope) -> str:
    """Return the name of the cookie of a server.

    Browsers send a cookie to every port of its host: the port as the browser has it, or ours where
    it has none, keeps two servers from taking each other's.
    """
    host = Headers(scope=scope).get("host", "")
    port = host.rpartition("]")[2].partition(":")[2]
    return f"rona_{port if port.isdecimal() else scope['server'][1]}"


def _name(host: str) -> str:
    """Return the host name of a Host header, without port and brackets."""
    host = host.lower()
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0]


def _cookies(headers: Headers, wanted: str) -> list[str]:
    found: list[str] = []
    for line in headers.getlist("cookie"):
        for part in line.split(";"):
            name, _, value = part.strip().partition("=")
            if name == wanted:
                found.append(value)
    return found


def _below(root: str, location: bytes) -> bytes:
    """Return an address of the application as a browser has it: a path below ``root``.

    The web framework writes whole addresses, with the scheme on our side of a proxy.
    """
    parts = urlsplit(location.decode("latin-1"))
    path = "/" + parts.path.lstrip("/")  # never //elsewhere
    return f"{root}{path}{'?' if parts.query else ''}{parts.query}".encode("latin-1")


def _with_headers(send: Send, root: str) -> Send:
    """Return ``send`` with headers for the browser, and a problem where a body was too large.

    Every `Location` is one of the application and gets the sub path ``root``.

    The body limit of the web framework answers in plain text.
    """
    replaced, body = False, b""

    async def sending(message: Message) -> None:
        nonlocal replaced, body
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ())]}
            for place, (name, value) in enumerate(message["headers"]):
                if name.lower() == b"location":
                    message["headers"][place] = name, _below(root, value)
            there = {name.lower(): value for name, value in message["headers"]}
            if message["status"] == 413 and there.get(b"content-type") != MEDIA_TYPE.encode():
                replaced = True
                answer = problem(413, "the body is larger than this route takes")
                message = {**message, "headers": answer.raw_headers}
                there = dict(answer.raw_headers)
                body = bytes(answer.body)
            extra = [(name, value) for name, value in HEADERS if name not in there]
            await send({**message, "headers": [*message["headers"], *extra]})
            if replaced:
                await send({"type": "http.response.body", "body": body})
        elif not replaced:
            await send(message)

    return sending
