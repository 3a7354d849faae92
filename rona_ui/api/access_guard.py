"""Access guard: checks Host, Origin and token of every request.

It wraps the whole application, so that pages, REST and the viewer's websocket obey one rule.
"""

import hmac
import ipaddress
from dataclasses import dataclass
from urllib.parse import parse_qsl, quote, unquote, urlencode

from starlette.datastructures import Headers, QueryParams
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rona_ui.api.problems import MEDIA_TYPE, problem

COOKIE = "rona_token"
LOOPBACK = ("localhost", "127.0.0.1", "::1")
FOREIGN = "requests from pages of other origins are refused"
SAFE = ("GET", "HEAD", "OPTIONS")
HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-frame-options", b"SAMEORIGIN"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


@dataclass(frozen=True, slots=True)
class Access:
    """Names the server answers to, and the token it wants; None lets everybody in."""

    token: str | None
    hosts: tuple[str, ...] = LOOPBACK


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

    def __init__(self, app: ASGIApp, access: Access) -> None:
        """Guard ``app``."""
        self._app = app
        self._access = access
        self._hosts = {host.lower().strip("[]") for host in access.hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check one request or websocket (ASGI)."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "http":
            await refusal(scope, receive, _with_headers(send))
        else:
            await receive()  # the request to connect; closing before accepting answers 403
            await send({"type": "websocket.close", "code": 1008, "reason": "refused"})

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if _name(host) not in self._hosts:
            text = "this server does not go by that name; see --allow-host"
            return problem(421, text)
        origin = headers.get("origin")
        websocket = scope["type"] == "websocket"
        if origin is not None and (websocket or scope["method"] not in SAFE):
            if origin.lower() not in (f"http://{host}".lower(), f"https://{host}".lower()):
                return problem(403, FOREIGN)
        site = headers.get("sec-fetch-site", "none").lower()  # which site's page asks for it
        if site not in ("none", "same-origin") and not websocket and scope["method"] not in SAFE:
            return problem(403, FOREIGN)
        if self._access.token is None:
            return None
        return self._unless_known(scope, headers)

    def _unless_known(self, scope: Scope, headers: Headers) -> Response | None:
        """Return None for who has the token; whoever brings it in the address gets a cookie."""
        if scope["type"] == "http" and scope["method"] in SAFE:
            brought = QueryParams(scope["query_string"]).get("token")
            if brought is not None and self._is_token(brought):
                return self._welcome(scope)
        scheme, _, value = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            known = self._is_token(value.strip())
        else:
            known = any(self._is_token(value) for value in _cookies(headers))
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
        path = "/" + scope["path"].lstrip("/")  # never //elsewhere
        response = RedirectResponse(f"{path}?{rest}" if rest else path, status_code=303)
        response.set_cookie(
            COOKIE,
            quote(self._access.token or "", safe=""),
            httponly=True,
            samesite="strict",
            path="/",
        )
        response.headers["Cache-Control"] = "no-store"
        return response


def _name(host: str) -> str:
    """Return the host name of a Host header, without port and brackets."""
    host = host.lower()
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0]


def _cookies(headers: Headers) -> list[str]:
    found: list[str] = []
    for line in headers.getlist("cookie"):
        for part in line.split(";"):
            name, _, value = part.strip().partition("=")
            if name == COOKIE:
                found.append(unquote(value))
    return found


def _with_headers(send: Send) -> Send:
    """Return ``send`` with headers for the browser, and a problem where a body was too large.

    The body limit of the web framework answers in plain text.
    """
    replaced, body = False, b""

    async def sending(message: Message) -> None:
        nonlocal replaced, body
        if message["type"] == "http.response.start":
            there = {name.lower(): value for name, value in message.get("headers", ())}
            if message["status"] == 413 and there.get(b"content-type") != MEDIA_TYPE.encode():
                replaced = True
                answer = problem(413, "the body is larger than this route takes")
                message = {**message, "headers": answer.raw_headers}
                there = dict(answer.raw_headers)
                body = bytes(answer.body)
            extra = [(name, value) for name, value in HEADERS if name not in there]
            await send({**message, "headers": [*message.get("headers", ()), *extra]})
            if replaced:
                await send({"type": "http.response.body", "body": body})
        elif not replaced:
            await send(message)

    return sending
