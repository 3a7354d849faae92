"""Half-open connections: how many stay, and whether others are answered meanwhile."""

import contextlib
import select
import socket
import statistics
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

from benchmarks.metric import Metric, Progress
from benchmarks.reliability.server_process import TOKEN, ServerProcess, server
from rona_ui.api.timed_protocol import BODY_S, HEAD_S

CONNECTIONS = 400
MARGIN_S = 10.0  # after the limit of the slowest kind
EVERY_S = 0.5  # between two requests beside them
HEAD = f"Host: localhost\r\nAuthorization: Bearer {TOKEN}\r\n"
# what is sent -> at once, a byte now and then, the limit of the server
KINDS: Mapping[str, tuple[str, bytes, float]] = {
    "nothing": ("", b"", HEAD_S),
    "half a header": (f"GET /api/v1/status HTTP/1.1\r\n{HEAD[:30]}", b"", HEAD_S),
    "a header byte by byte": ("GET /api/v1/status HTTP/1.1\r\nX-Slow: ", b"x", HEAD_S),
    "half a body": (
        f"POST /api/v1/sessions HTTP/1.1\r\n{HEAD}Content-Length: 30\r\n\r\n{{",
        b"",
        BODY_S,
    ),
}


def run(progress: Progress) -> list[Metric]:
    """Return how many connections stay, and how long requests and Stop take beside them."""
    with tempfile.TemporaryDirectory() as folder, server(Path(folder)) as started:
        started.open("/status").close()  # the first one makes the devices
        alone_ms = statistics.median(_stop_ms(started) for _ in range(20))
        limit_s = max(limit for _, _, limit in KINDS.values()) + MARGIN_S
        progress(f"{CONNECTIONS} half-open connections for at most {limit_s:g} s")
        with contextlib.ExitStack() as ends:
            held = _connect(started.port, ends)
            stops_ms, reads_ms = _beside(started, held, limit_s)
            left = {kind: sum(not _ended(made) for made in each) for kind, each in held.items()}
    count = len(stops_ms)
    return [
        *(
            Metric(f"{kind}: left, of {len(held[kind])}", number, "connections", "lower", 0.0)
            for kind, number in left.items()
        ),
        Metric(f"Stop beside them: worst of {count}", max(stops_ms), "ms", "lower", 100.0),
        Metric(f"status beside them: worst of {count}", max(reads_ms), "ms", "lower", 500.0),
        Metric("Stop alone: median", alone_ms, "ms", "lower"),
    ]


def _connect(port: int, ends: contextlib.ExitStack) -> dict[str, list[socket.socket]]:
    held: dict[str, list[socket.socket]] = {kind: [] for kind in KINDS}
    kinds = list(KINDS)
    for number in range(CONNECTIONS):
        kind = kinds[number % len(kinds)]
        made = ends.enter_context(socket.create_connection(("127.0.0.1", port), 20))
        made.sendall(KINDS[kind][0].encode())
        held[kind].append(made)
    return held


def _beside(
    started: ServerProcess, held: Mapping[str, list[socket.socket]], limit_s: float
) -> tuple[list[float], list[float]]:
    """Return the times of Stop and of the status, in ms, until all connections have ended."""
    stops_ms: list[float] = []
    reads_ms: list[float] = []
    end_s = time.monotonic() + limit_s
    while time.monotonic() < end_s:
        for kind, each in held.items():
            slow = KINDS[kind][1]
            for made in each if slow else ():
                with contextlib.suppress(OSError):  # it has ended
                    made.sendall(slow)
        stops_ms.append(_stop_ms(started))
        begin_s = time.monotonic()
        started.open("/status").close()
        reads_ms.append(1e3 * (time.monotonic() - begin_s))
        if all(_ended(made) for each in held.values() for made in each):
            break
        time.sleep(EVERY_S)
    return stops_ms, reads_ms


def _stop_ms(started: ServerProcess) -> float:
    begin_s = time.monotonic()
    started.open("/sessions/current/robot/stop", {}).close()
    return 1e3 * (time.monotonic() - begin_s)


def _ended(made: socket.socket) -> bool:
    """Return whether the server has closed a connection; what it said before is left out."""
    poll = select.poll()
    poll.register(made, select.POLLIN)
    with contextlib.suppress(OSError):
        while poll.poll(0):
            if not made.recv(1 << 16):
                return True
        return False
    return True
