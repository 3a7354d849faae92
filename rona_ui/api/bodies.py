"""Bodies of requests: bounded by route, parsed and validated in a thread; their schema.

JSON bodies: bounded by route, parsed and validated in a thread, keys that stand twice refused. The
event loop answers Stop, so nothing that grows with a body is done in it.
"""

import asyncio
import dataclasses
import json
import os
import types
import typing
from collections.abc import AsyncGenerator, Callable, Coroutine, Iterable, Iterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import (
    Annotated,
    Any,
    BinaryIO,
    Literal,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from fastapi import APIRouter, Query
from fastapi._compat import ModelField
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import AfterValidator
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware.body_limit import MAX_BODY_SIZE_SCOPE_KEY
from starlette.requests import Request
from starlette.responses import Response

from rona_core.devices.limits import (
    INNER,
    OF_LISTS,
    OF_NUMBERS,
    OF_TEXTS,
    limits_of,
    meaning,
    require,
)
from rona_core.devices.settings import hidden_characters
from rona_core.errors import storing
from rona_core.session.files import open_temporary

BODY_BYTES = 64 * 1024  # of a request whose route states nothing else
NUMBER_BYTES = 26  # of a number with all its digits, sign, exponent, comma and blank
AT_ONCE = 4  # reads and validations that compute: each has the interpreter for 5 ms before Stop has
COUNT_BYTES = 12  # of a whole number
TEXT_BYTES = 256  # of a text, with its quotes; longer ones stand alone in a body of 64 KB


def body_bytes(kind: type) -> int:
    """Return how many bytes a body may have: 64 KB, or what its longest lists may need.

    Raises:
        TypeError: a list of the message has no ``maxItems``.
    """
    return max(BODY_BYTES, _most_bytes(kind, {}))


def _most_bytes(hint: Any, words: Mapping[str, Any]) -> int:
    """Return the most bytes that a value of a type needs, with the limits of its field."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return max(_most_bytes(part, words) for part in arguments)
    if origin is tuple and Ellipsis in arguments:
        if "maxItems" not in words:
            raise TypeError(f"{hint}: state how long it may be, limited(maxItems=…)")
        inner = words.get(INNER, {})
        return 4 + words["maxItems"] * (2 + _most_bytes(arguments[0], inner))
    if origin is tuple:
        return 4 + sum(_most_bytes(part, {}) for part in arguments)
    if is_dataclass(hint):
        hints, limits = get_type_hints(hint), limits_of(hint)
        names = [field.name for field in fields(hint)]
        return 4 + sum(len(name) + 6 + _most_bytes(hints[name], limits[name]) for name in names)
    if hint is str or origin is Literal:
        return TEXT_BYTES
    return COUNT_BYTES if hint is int else NUMBER_BYTES


class BodyRoute(APIRoute):
    """A route that refuses what is too large before it does anything, and validates in a thread."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return what answers a request."""
        handle = super().get_route_handler()
        field = self.body_field

        async def checked(request: Request) -> Response:
            _require_length(request)
            turns: asyncio.Semaphore = request.app.state.turns
            if request.method == "GET":
                async with turns:
                    return await handle(request)
            if field is None or not _is_json(request):
                return await handle(request)
            raw = await request.body()
            async with turns:
                value = await run_in_threadpool(_validated, raw, field) if raw else None
            return await handle(_Validated(request, raw, value))

        return checked


class _Validated(Request):
    """A request whose body has been read, and made a value of its type."""

    def __init__(self, request: Request, raw: bytes, value: Any) -> None:
        super().__init__(request.scope, request.receive)
        self._raw = raw
        self._value = value

    async def body(self) -> bytes:
        """Return the bytes."""
        return self._raw

    async def json(self) -> Any:
        """Return the value in the place of the JSON; FastAPI takes it as it is."""
        return self._value


def _require_length(request: Request) -> None:
    """Refuse a body by its stated length: a route that never reads it would act, then refuse."""
    limit = request.scope.get(MAX_BODY_SIZE_SCOPE_KEY, BODY_BYTES)
    stated = request.headers.get("content-length", "0")
    if stated.isdecimal() and int(stated) > limit:
        raise HTTPException(413, f"expected a body of at most {limit} bytes, not {stated}")


def _is_json(request: Request) -> bool:
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    return kind == "application/json" or (
        kind.startswith("application/") and kind.endswith("+json")
    )


def _validated(raw: bytes, field: ModelField) -> Any:
    """Return the value of a body.

    Raises:
        HTTPException: it cannot be read as text, or is nested too deeply.
        RequestValidationError: it is no JSON, a key stands twice, or a value does not fit.
    """
    value = parsed(raw)
    if value is None:  # as if it were left out
        return None
    found, errors = field.validate(value, {}, loc=("body",))
    if errors:
        raise RequestValidationError(errors)
    return found


class _Doubled(dict[str, Any]):
    """An object with a key that stands twice."""

    key = ""


def parsed(raw: bytes) -> Any:
    """Return JSON as values; errors as in ``_validated``."""
    doubled: list[_Doubled] = []

    def whole(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) == len(pairs):
            return found
        names: set[str] = set()
        marked = _Doubled(found)
        marked.key = next(name for name, _ in pairs if name in names or names.add(name))
        doubled.append(marked)
        return marked

    try:
        value = json.loads(raw, object_pairs_hook=whole)
    except json.JSONDecodeError as error:
        place = {"loc": ("body", error.pos), "msg": "JSON decode error", "type": "json_invalid"}
        raise RequestValidationError([place]) from error
    except (ValueError, RecursionError) as error:
        raise HTTPException(400, "the body cannot be read as JSON") from error
    if doubled:
        wrong = [
            {"loc": ("body", *path), "msg": "this key stands twice: leave one", "type": "doubled"}
            for path in _doubled_in(value, ())
        ]
        text = f"the key {doubled[0].key[:80]!r} stands twice in an object: leave one"
        raise RequestValidationError(wrong or [{"loc": ("body",), "msg": text, "type": "doubled"}])
    return value


def _doubled_in(value: Any, path: tuple[str | int, ...]) -> Iterator[tuple[str | int, ...]]:
    """Yield the paths of keys that stand twice; of those that were written over, none."""
    if isinstance(value, dict):
        if isinstance(value, _Doubled):
            yield (*path, value.key)
        for name, item in cast("dict[str, Any]", value).items():
            yield from _doubled_in(item, (*path, name))
    elif isinstance(value, list):
        for number, item in enumerate(cast("list[Any]", value)):
            yield from _doubled_in(item, (*path, number))


def _seen(name: str) -> str:
    """Return a name in which every character can be seen.

    Raises:
        InvalidInputError: there are hidden characters in it.
    """
    require(not hidden_characters(name), f"hidden characters in the name {name[:60]!a}")
    return name


FileName = Annotated[
    str,
    Query(min_length=1, max_length=120, description="plain file name"),
    AfterValidator(_seen),
]
RAW_BODY = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}
WRITTEN_AT_ONCE = 1 << 20  # bytes that are written together


@asynccontextmanager
async def spooled(request: Request, folder: Path) -> AsyncGenerator[Path]:
    """Give a file in ``folder`` that holds the body; unless it was moved away, it goes afterwards.

    A body that is cut off or too large for its route leaves nothing behind.

    Raises:
        RequestValidationError: there is no body.
        StorageError: the file system refused.
    """
    with storing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        handle, path = open_temporary(folder / "upload")
    try:
        with os.fdopen(handle, "wb") as file:
            with storing(folder):
                await _spool(request, file)
            if not file.tell():
                text = "expected the file as the body"
                raise RequestValidationError([{"loc": ("body",), "msg": text, "type": "missing"}])
            yield path  # while it is still locked, so that it is not taken for one left behind
    finally:
        path.unlink(missing_ok=True)


async def _spool(request: Request, file: BinaryIO) -> None:
    """Write a body to the end, and to the disk."""
    held: list[bytes] = []
    async for part in request.stream():
        held.append(part)
        if sum(map(len, held)) >= WRITTEN_AT_ONCE:
            await run_in_threadpool(file.writelines, held)
            held = []
    file.writelines(held)
    file.flush()
    await run_in_threadpool(os.fsync, file.fileno())


Schema = dict[str, Any]
_OF_TYPE = {"number": OF_NUMBERS, "integer": OF_NUMBERS, "array": OF_LISTS, "string": OF_TEXTS}


def add_limits(document: Schema, routers: Iterable[APIRouter]) -> None:
    """Add the limits that fields of dataclasses declare to their schemas in a document.

    Args:
        document: An OpenAPI document, which is changed.
        routers: Their routes are looked through for dataclasses.
    """
    schemas = document["components"]["schemas"]
    hints = [
        hint
        for router in routers
        for route in router.routes
        if isinstance(route, APIRoute)
        for hint in typing.get_type_hints(route.endpoint).values()
    ]
    for kind in _dataclasses(hints, set()):
        fields = schemas.get(kind.__name__, {}).get("properties", {})
        for name, words in limits_of(kind).items():
            if words and name in fields:
                _describe(fields[name], words)


def _dataclasses(hints: Iterable[Any], seen: set[Any]) -> Iterator[Any]:
    """Yield the dataclasses in types of parameters and answers, and in those of their fields."""
    for hint in hints:
        if dataclasses.is_dataclass(hint) and hint not in seen:
            seen.add(hint)
            yield hint
            yield from _dataclasses(typing.get_type_hints(hint).values(), seen)
        yield from _dataclasses(typing.get_args(hint), seen)


def _describe(field: Schema, words: Mapping[str, Any]) -> None:
    _limit(field, words)
    if "label" in words:
        field["title"] = words["label"]
    unit = f"In {words['unit']}" if words.get("unit") else ""
    if said := ". ".join(filter(None, (unit, meaning(words)))):
        field["description"] = said


def _limit(schema: Schema, words: Mapping[str, Any]) -> None:
    """Add limits to a schema and to those in it; those of a list to its own alone."""
    allowed = _OF_TYPE.get(schema.get("type", ""), ())
    schema |= {
        name: list(words[name]) if name == "enum" else words[name]
        for name in allowed
        if name in words
    }
    inner = words
    if schema.get("type") == "array":
        inner = {name: word for name, word in words.items() if name not in OF_LISTS}
        inner |= words.get(INNER, {})
    parts = [*schema.get("anyOf", ()), *schema.get("prefixItems", ())]
    for part in (*parts, schema["items"]) if "items" in schema else parts:
        _limit(cast("Schema", part), inner)
