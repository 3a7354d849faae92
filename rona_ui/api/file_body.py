"""Files that come as the body of a request."""

import os
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Annotated, BinaryIO

from fastapi import Query, Request
from fastapi.exceptions import RequestValidationError
from pydantic import AfterValidator
from starlette.concurrency import run_in_threadpool

from rona_core.devices.limits import require
from rona_core.devices.settings import hidden_characters
from rona_core.errors import storing
from rona_core.session.files import open_temporary


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
AT_ONCE = 1 << 20  # bytes that are written together


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
        if sum(map(len, held)) >= AT_ONCE:
            await run_in_threadpool(file.writelines, held)
            held = []
    file.writelines(held)
    file.flush()
    await run_in_threadpool(os.fsync, file.fileno())
