"""Bodies of uploads go to a file while they arrive: they never lie in memory whole."""

import os
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from starlette.concurrency import run_in_threadpool

from rona_core.session.files import open_temporary

AT_ONCE = 1 << 20  # bytes that are written together


@asynccontextmanager
async def spooled(request: Request, folder: Path) -> AsyncGenerator[Path]:
    """Give a file in ``folder`` that holds the body; unless it was moved away, it goes afterwards.

    A body that is cut off or too large for its route leaves nothing behind.

    Raises:
        RequestValidationError: there is no body.
    """
    folder.mkdir(parents=True, exist_ok=True)
    handle, path = open_temporary(folder / "upload")
    try:
        with os.fdopen(handle, "wb") as file:
            held: list[bytes] = []
            async for part in request.stream():
                held.append(part)
                if sum(map(len, held)) >= AT_ONCE:
                    await run_in_threadpool(file.writelines, held)
                    held = []
            file.writelines(held)
            file.flush()
            await run_in_threadpool(os.fsync, file.fileno())
            if not file.tell():
                text = "expected the file as the body"
                raise RequestValidationError([{"loc": ("body",), "msg": text, "type": "missing"}])
            yield path  # while it is still locked: nobody takes it for one that was left behind
    finally:
        path.unlink(missing_ok=True)
