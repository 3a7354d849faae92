"""How long Stop takes beside each kind of load, as a share of what it takes alone.

The server is a process of its own; the load comes from threads of a second process, Stop from this
one, over a connection that is kept, as a browser keeps it.
"""

import http.client
import json
import multiprocessing
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from multiprocessing.synchronize import Event
from pathlib import Path

import numpy as np

from benchmarks.metric import Metric, Progress
from benchmarks.reliability.server_process import TOKEN, server

STOPS = 200  # beside each load
APART_S = 0.02  # between two of them
CLIENTS = 4  # of a load, at once
LONGEST_MS = 100.0  # that 99 of 100 may take, on two quiet cores

Request = tuple[str, str, bytes | None]  # method, path, body
HEAD = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"}
HERE = "/api/v1/sessions/current"
PAINT = f"{HERE}/commands/PaintRegion"


def _painted(places: list[object]) -> bytes:
    return json.dumps({"kind": "scan", "stroke_base_mm": places}).encode()


LOADS: Mapping[str, tuple[Request, ...]] = {
    "reads of results": (("GET", f"{HERE}/results/maps", None),),
    "reads of RF": (
        ("GET", f"{HERE}/results/maps/array?at=/captures/second/value/0/scans/rf", None),
    ),
    "reads of figures and report": (
        ("GET", f"{HERE}/quality", None),
        ("GET", f"{HERE}/report", None),
    ),
    "downloads of the session file": (("GET", f"{HERE}/file", None),),
    "event streams from the first change": (("GET", f"{HERE}/events?since=0", None),),
    "the document of all routes": (("GET", "/api/v1/openapi.json", None),),
    "uploads of 32 MB": (("POST", f"{HERE}/uploads?name=large.nrrd", bytes(32_000_000)),),
    "bodies of 0.9 MB": (("POST", PAINT, _painted([["x"] * 3] * 60_000)),),
    "bodies that do not fit": (("POST", PAINT, _painted([["x"] * 3] * 4_000)),),
    "bodies with 4000 unknown keys": (
        ("POST", PAINT, json.dumps({f"k{number}": 1 for number in range(4000)}).encode()),
    ),
    "strokes of 500 places": (("POST", PAINT, _painted([[1000.0, 2000.0, 1.5]] * 500)),),
    "commands": (("POST", f"{HERE}/commands/SetSeed", b'{"seed": 3}'),),
    "jobs": (
        ("POST", f"{HERE}/jobs/StartProbeSweep", b'{"n": 400}'),
        ("GET", "/api/v1/jobs", None),
    ),
}


def run(progress: Progress) -> list[Metric]:
    """Return how long Stop takes alone, and beside each kind of load."""
    with tempfile.TemporaryDirectory() as folder, server(Path(folder)) as program:
        port = program.port
        with program.open("/sessions/current/quality"):
            pass  # what is computed once is computed
        progress("Stop alone")
        alone_ms = _p99(_stops(port))
        metrics = [Metric("Stop alone, p99", alone_ms, "ms", "lower", goal=LONGEST_MS)]
        for name, requests in LOADS.items():
            progress(f"Stop beside {name}")
            beside_ms, answers = _beside(port, requests)
            metrics += [
                Metric(f"Stop beside {name}, p99", beside_ms, "ms", "lower", goal=LONGEST_MS),
                Metric(f"Stop beside {name}, p99 to alone", beside_ms / alone_ms, "", "lower"),
                Metric(f"{name}: answers meanwhile", answers, "", "higher", goal=1),
            ]
    return metrics


def _p99(times_ms: list[float]) -> float:
    return float(np.percentile(times_ms, 99))


def _stops(port: int) -> list[float]:
    """Return how long each of ``STOPS`` calls took, in ms."""
    wire = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    times_ms: list[float] = []
    for _ in range(STOPS):
        begin = time.perf_counter()
        wire.request("POST", f"{HERE}/robot/stop", headers=HEAD)
        wire.getresponse().read()
        times_ms.append((time.perf_counter() - begin) * 1000.0)
        time.sleep(APART_S)
    wire.close()
    return times_ms


def _beside(port: int, requests: tuple[Request, ...]) -> tuple[float, int]:
    """Return the p99 of Stop in ms beside a load, and how often the load was answered."""
    context = multiprocessing.get_context("spawn")
    begun, end, answers = context.Event(), context.Event(), context.Queue()
    load = context.Process(target=keep_busy, args=(port, requests, begun, end, answers.put))
    load.start()
    begun.wait(60.0)
    try:
        times_ms = _stops(port)
    finally:
        end.set()
    count = answers.get(timeout=120.0)
    load.join()
    return _p99(times_ms), count


def keep_busy(
    port: int,
    requests: tuple[Request, ...],
    begun: Event,
    end: Event,
    say: Callable[[int], None],
) -> None:
    """Send ``requests`` over and over from ``CLIENTS`` threads; say how many were answered."""
    counts = [0] * CLIENTS

    def client(number: int) -> None:
        while not end.is_set():
            for method, path, body in requests:
                wire = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
                try:
                    begun.set()
                    wire.request(method, path, body, HEAD)
                    answer = wire.getresponse()
                    if "/events" in path:
                        answer.read(4096)  # it has no end
                    else:
                        answer.read()
                    counts[number] += 1
                except (ConnectionError, http.client.HTTPException):
                    counts[number] += 1  # refused while the body was still on its way
                finally:
                    wire.close()

    threads = [threading.Thread(target=client, args=(number,)) for number in range(CLIENTS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    say(sum(counts))
