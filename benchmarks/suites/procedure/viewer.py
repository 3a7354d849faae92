"""The viewer after many short visits: browsers that are kept, CPU of the idle server, memory."""

import asyncio
import gc
import tempfile
import threading
import time
import warnings
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec
import viser
import websockets.asyncio.client

from benchmarks.metric import Metric, Progress
from benchmarks.reliability.server_process import TOKEN
from rona_core.compose import build_registry
from rona_ui.resources import demo_session
from rona_ui.server import ServerSettings, server_of
from rona_ui.viewer.gateway import ViewerGateway
from rona_ui.window.window import Window, open_window

VISITS, STAY_S = 100, 0.3
WARM_UP = 10  # visits before memory is compared: threads and caches are there once
SETTLE_S, IDLE_S = 20.0, 20.0
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, 0.0, 3.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 10.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


@dataclass(frozen=True, slots=True)
class Idle:
    """The server while nobody visits."""

    cpu_percent: float  # of one core
    kept: int
    objects: int  # that Python's garbage collector knows


def run(progress: Progress) -> list[Metric]:
    """Return what short visits leave behind, the server idle on the demo session."""
    warnings.filterwarnings("ignore", message="Queued a", category=UserWarning)  # for who has left
    with _server() as (port, window):
        _visit(port, WARM_UP)
        before = _idle(window)
        progress(f"before: CPU {before.cpu_percent:.2f} %, {before.objects} objects")
        _visit(port, VISITS)
        after = _idle(window)
    what = f"after {VISITS} visits of {STAY_S:g} s"
    grown = 100.0 * (after.objects / before.objects - 1.0)
    return [
        Metric("idle CPU before", before.cpu_percent, "%", "lower"),
        Metric(f"idle CPU {what}", after.cpu_percent, "%", "lower", 1.0),
        Metric(f"browsers kept {what}", float(after.kept), "", "lower", 0.0),
        Metric(f"objects more {what}", grown, "%", "lower", 1.0),
    ]


@contextmanager
def _server() -> Generator[tuple[int, Window]]:
    """Serve a copy of the demo session; yields port and window."""
    with ExitStack() as ends:
        folder = Path(ends.enter_context(tempfile.TemporaryDirectory()))
        hub = build_registry(folder, processes=False)
        ends.callback(hub.close_all)
        hub.open_path(demo_session())
        gateway = ViewerGateway()
        ends.callback(gateway.close)
        window = open_window(gateway.server, hub)
        ends.callback(window.close)
        settings = ServerSettings(port=0, sessions=folder, token=TOKEN, open_browser=False)
        server = server_of(hub, gateway, settings)
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        ends.callback(thread.join, 20.0)
        ends.callback(setattr, server, "should_exit", True)
        while not server.started:
            time.sleep(0.01)
        yield server.servers[0].sockets[0].getsockname()[1], window


def _idle(window: Window) -> Idle:
    """Return how the server does once the last visit is over."""
    time.sleep(SETTLE_S)
    gc.collect()
    cpu_s, since_s = time.process_time(), time.monotonic()
    time.sleep(IDLE_S)
    percent = 100.0 * (time.process_time() - cpu_s) / (time.monotonic() - since_s)
    return Idle(percent, len(window.browsers), len(gc.get_objects()))


def _visit(port: int, visits: int) -> None:
    for _ in range(visits):
        asyncio.run(one_visit(port, STAY_S))


async def one_visit(port: int, stay_s: float) -> None:
    """Connect as a browser does, say where the camera is, stay a while and leave."""
    async with websockets.asyncio.client.connect(
        f"ws://127.0.0.1:{port}/viewer",
        subprotocols=[websockets.Subprotocol(f"viser-v{viser.__version__}")],
        additional_headers={"Authorization": f"Bearer {TOKEN}"},
        proxy=None,
        max_size=None,
    ) as socket:
        await socket.send(msgspec.msgpack.encode(CAMERA))
        end_s = time.monotonic() + stay_s
        while (left_s := end_s - time.monotonic()) > 0.0:
            try:
                await asyncio.wait_for(socket.recv(), left_s)
            except TimeoutError:
                return
