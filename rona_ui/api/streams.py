"""Server-sent events: asynchronous, without a thread per follower, ended when the server ends."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable, Generator
from typing import Any

from starlette.responses import StreamingResponse

PERIOD_S = 15.0  # a sign of life at least this often
ALIVE = b": alive\n\n"


class EventStream(StreamingResponse):
    """A response of server-sent events."""

    media_type = "text/event-stream"

    def __init__(self, events: AsyncIterator[bytes], status_code: int = 200) -> None:
        """Send ``events`` as they come; FastAPI reads the status from this signature."""
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        super().__init__(_one_by_one(events), status_code, headers=headers)


async def _one_by_one(events: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """Let the event loop do other things between any two events, however many are there."""
    async for each in events:
        yield each
        await asyncio.sleep(0)


class Waker:
    """Wakes one stream from any thread."""

    def __init__(self) -> None:
        """Belong to the running event loop."""
        self._loop = asyncio.get_running_loop()
        self._event = asyncio.Event()

    def wake(self, *_: Any) -> None:
        """Wake the stream; safe from any thread, and after the loop has ended."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._event.set)

    async def wait(self, timeout_s: float = PERIOD_S) -> bool:
        """Return True once ``wake`` was called, or False after the timeout."""
        try:
            await asyncio.wait_for(self._event.wait(), timeout_s)
        except TimeoutError:
            return False
        self._event.clear()
        return True


class Streams:
    """All streams that are open, so that the server can end them."""

    def __init__(self) -> None:
        """Start with none."""
        self._wakers: set[Waker] = set()
        self.closing = False

    def __len__(self) -> int:
        return len(self._wakers)

    def close(self) -> None:
        """End every stream."""
        self.closing = True
        for waker in tuple(self._wakers):
            waker.wake()

    @contextlib.contextmanager
    def waker(
        self, *sources: Callable[[Callable[..., None]], Callable[[], None]]
    ) -> Generator[Waker]:
        """Return a waker that is subscribed to ``sources`` as long as the block runs."""
        waker = Waker()
        self._wakers.add(waker)
        with contextlib.ExitStack() as ends:
            ends.callback(self._wakers.discard, waker)
            for subscribe in sources:
                ends.callback(subscribe(waker.wake))
            yield waker


def event(data: Any, *, kind: str | None = None, number: int | None = None) -> bytes:
    """Return one event with JSON data."""
    lines = [] if number is None else [f"id: {number}"]
    lines += [] if kind is None else [f"event: {kind}"]
    lines.append(f"data: {json.dumps(data, allow_nan=False, separators=(',', ':'))}")
    return ("\n".join(lines) + "\n\n").encode()


DESCRIBED: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "Server-sent events, one JSON object each; endless until you leave",
        "content": {"text/event-stream": {"schema": {"type": "string"}}},
    }
}
