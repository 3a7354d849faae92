"""Answers as they go out: large ones in pieces, packed where it pays; none holds the event loop."""

import asyncio
import zlib

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

PIECE = 256 * 1024  # bytes that are handed on together
LEAST_PACKED = 64 * 1024  # bytes; shorter answers are not packed
PAYS = 0.7  # share of its length to which a sample must shrink
GZIP = 16 + zlib.MAX_WBITS


class InPieces:
    """Sends what ``app`` answers in pieces, between which the event loop does other things.

    An answer of more than ``LEAST_PACKED`` bytes is packed (gzip, in a thread) for a client that
    takes it so, where its first bytes shrink: text and RF do, files that are packed already do not.
    """

    def __init__(self, app: ASGIApp) -> None:
        """Stand around ``app``."""
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        takes = "gzip" in Headers(scope=scope).get("accept-encoding", "")
        start: Message | None = None

        async def sending(message: Message) -> None:
            nonlocal start
            if message["type"] == "http.response.start":
                if "content-length" in Headers(raw=message["headers"]):
                    start = message  # until it is clear whether the body is packed
                else:  # a stream: who follows it sees at once that it is open
                    await send(message)
                return
            body = message.get("body", b"")
            if start is not None:
                if takes and not message.get("more_body") and len(body) > LEAST_PACKED:
                    body = await _packed(body, MutableHeaders(raw=start["headers"]))
                await send(start)
                start = None
            await _send_pieces(send, {**message, "body": body})

        await self._app(scope, receive, sending)


async def _packed(body: bytes, headers: MutableHeaders) -> bytes:
    headers.add_vary_header("Accept-Encoding")
    if "content-encoding" in headers or len(_gzip(body[:LEAST_PACKED])) > PAYS * LEAST_PACKED:
        return body
    packed = await run_in_threadpool(_gzip, body)
    headers["Content-Encoding"] = "gzip"
    headers["Content-Length"] = str(len(packed))
    return packed


def _gzip(data: bytes) -> bytes:
    packer = zlib.compressobj(1, zlib.DEFLATED, GZIP)
    return packer.compress(data) + packer.flush()


async def _send_pieces(send: Send, message: Message) -> None:
    view = memoryview(message["body"])
    for begin in range(0, max(len(view), 1), PIECE):
        end = begin + PIECE
        more = end < len(view) or message.get("more_body", False)
        await send({**message, "body": bytes(view[begin:end]), "more_body": more})
        if more:
            await asyncio.sleep(0)
