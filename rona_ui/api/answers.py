"""Answers as they go out: results as plain JSON, large ones in pieces."""

import asyncio
import dataclasses
import io
import math
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, cast
from urllib.parse import quote

import msgspec
import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rona_core.errors import NotFoundError
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.codec import LEAST

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


LONGEST_ARRAY = 1000  # values of an array that JSON holds, some 20 KB
NPY = "application/octet-stream"


def described(*kinds: str) -> dict[int | str, dict[str, Any]]:
    """Return what the document says of an answer: JSON of these kinds, ``object`` or ``null``."""
    schema = {"type": kinds[0] if len(kinds) == 1 else list(kinds)}
    return {200: {"content": {"application/json": {"schema": schema}}}}


class FastJson(Response):
    """JSON that is encoded where it is made, in the thread of the handler."""

    media_type = "application/json"

    def render(self, content: Any) -> bytes:
        """Encode ``content``."""
        return msgspec.json.encode(content)


def plain(value: Any, max_points: int | None = None, array_at: str | None = None) -> Any:
    """Return ``value`` as JSON values: poses as quaternion and translation, arrays as lists.

    Args:
        value: A dataclass of the session, or what it consists of.
        max_points: Longest array along its first axis; longer ones are thinned out evenly, all
            of one length in the same way, so that rows still belong together.
        array_at: Where the arrays of ``value`` can be had, an address relative to that of the
            answer that ends in a JSON pointer. Arrays of more than ``LONGEST_ARRAY`` values are
            then a reference: ``shape``, ``dtype`` and the address ``npy``. None: all are lists.
    """
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, np.ndarray):
        return _plain_array(value, max_points, array_at)
    inside = _opened(value)
    if isinstance(inside, dict):
        return {
            name: plain(item, max_points, _below(array_at, name)) for name, item in inside.items()
        }
    if isinstance(inside, list):
        return [
            plain(item, max_points, _below(array_at, str(number)))
            for number, item in enumerate(inside)
        ]
    return inside


def array_in(value: Any, pointer: str) -> NDArray[Any]:
    """Return the array at a JSON pointer into what ``plain`` makes of ``value``.

    Raises:
        NotFoundError: there is no array.
    """
    held = value
    for token in pointer.split("/")[1:]:
        name = token.replace("~1", "/").replace("~0", "~")
        inside = _opened(held)
        if isinstance(inside, dict) and name in inside:
            held = inside[name]
        elif isinstance(inside, list) and name.isdecimal() and int(name[:9]) < len(inside):
            held = inside[int(name[:9])]
        else:
            raise NotFoundError(_no_array(pointer))
    if not isinstance(held, np.ndarray):
        raise NotFoundError(_no_array(pointer))
    return held


def npy_of(array: NDArray[Any]) -> bytes:
    """Return an array as a file of numpy (``.npy``), in C order."""
    file = io.BytesIO()
    np.lib.format.write_array(file, np.ascontiguousarray(array), allow_pickle=False)
    return file.getvalue()


def _no_array(pointer: str) -> str:
    return f"there is no array at {pointer!r}: take `npy` of the results as it stands there"


def _below(array_at: str | None, name: str) -> str | None:
    if array_at is None:
        return None
    return f"{array_at}/{quote(name.replace('~', '~0').replace('/', '~1'), safe='')}"


def _opened(value: Any) -> Any:
    """Return a dict or a list of what ``value`` consists of, or what has no parts as it is."""
    if value is None or isinstance(value, bool | int | float | str | np.generic | np.ndarray):
        return value
    if isinstance(value, Pose):
        return {"wxyz": value.wxyz(), "translation_mm": value.translation}
    if isinstance(value, Poses):
        return {"wxyz": value.wxyz(), "translations_mm": value.translations}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _resolved(field, value) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): item for key, item in value.items()}
    return list(cast("Sequence[Any]", value))


def _resolved(field: dataclasses.Field[Any], owner: Any) -> Any:
    """Return the value of a field; None for an estimate that did not leave its lower bound."""
    value, least = getattr(owner, field.name), field.metadata.get(LEAST)
    return None if least is not None and value is not None and value <= least else value


def _plain_array(array: NDArray[Any], max_points: int | None, array_at: str | None) -> Any:
    shape = array.shape
    if max_points is not None and array.ndim and len(array) > max_points:
        array = array[np.linspace(0, len(array) - 1, max_points).round().astype(int)]
    if array_at is not None and array.size > LONGEST_ARRAY:
        return {"shape": list(shape), "dtype": array.dtype.name, "npy": array_at}
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        masked = array.astype(object)
        masked[~np.isfinite(array)] = None
        return masked.tolist()
    return array.tolist()
