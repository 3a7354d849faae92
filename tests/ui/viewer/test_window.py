"""Browsers come and go: one that leaves while its page is being built is kept by nobody."""

import asyncio
import contextlib
import threading
import time
from collections.abc import Awaitable, Callable, Generator, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
import viser
import websockets.asyncio.client

from rona_core.app.runtime.jobs import Ended, JobStatus
from rona_core.app.steps.maps.comparison import MapComparison
from rona_core.app.steps.maps.messages import StartComparison
from rona_core.compose import build_registry
from rona_core.errors import InvalidInputError
from rona_core.mapping.comparison.map_errors import MapErrors
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.server import ServerSettings, server_of
from rona_ui.viewer.gateway import ViewerGateway
from rona_ui.window import window as window_module
from rona_ui.window.browser import Browser
from rona_ui.window.window import Window
from tests.helpers.ui.fake_gui import FakeClient

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
TOKEN = "token-of-the-window-test"


class Client(FakeClient):
    """A browser with a number."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.client_id = number


class FakeServer:
    """Tells of browsers in viser's order: out of the list first, then word of it."""

    def __init__(self) -> None:
        self.scene = SimpleNamespace(world_axes=SimpleNamespace(visible=True))
        self.gui = SimpleNamespace(configure_theme=lambda **_: None)
        self.clients: dict[int, Client] = {}

    def get_clients(self) -> dict[int, Client]:
        return dict(self.clients)

    def on_client_connect(self, call: Any) -> None:
        self.told_of_coming = call

    def on_client_disconnect(self, call: Any) -> None:
        self.told_of_leaving = call

    def leave(self, client: Client) -> None:
        self.clients.pop(client.client_id, None)
        self.told_of_leaving(client)


class FakeBrowser:
    """Takes as long to be built as the test wants, and counts what is drawn for it."""

    hold = threading.Event()
    building = threading.Event()
    built = 0

    def __init__(self, client: Client, *_: Any) -> None:
        FakeBrowser.built += 1
        self.client, self.view, self.pictures = client, ViewState(step="pointer"), 0
        FakeBrowser.building.set()
        FakeBrowser.hold.wait(10.0)

    def draw(self, snapshot: Snapshot) -> None:
        self.pictures += 1
        self.newest = snapshot


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[FakeServer, Window]]:
    monkeypatch.setattr(window_module, "Browser", FakeBrowser)
    FakeBrowser.hold.set()
    FakeBrowser.building.clear()
    FakeBrowser.built = 0
    hub, server = build_registry(tmp_path, processes=False), FakeServer()
    hub.create()
    window = Window(server, hub)  # type: ignore[arg-type]
    yield server, window
    window.close()
    hub.close_all()


def soon(condition: Any) -> bool:
    end = time.monotonic() + 60.0
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return bool(condition())


def test_a_browser_that_leaves_while_its_page_is_built_is_not_kept(world: Any) -> None:
    server, window = world
    server.clients[1] = client = Client(1)
    FakeBrowser.hold.clear()
    coming = threading.Thread(target=server.told_of_coming, args=(client,))
    coming.start()
    assert FakeBrowser.building.wait(10.0)
    server.leave(client)
    FakeBrowser.hold.set()
    coming.join(10.0)
    assert window.browsers == ()


def test_a_browser_that_has_left_before_its_turn_came_is_not_even_built(world: Any) -> None:
    server, window = world
    server.told_of_coming(Client(1))
    assert FakeBrowser.built == 0
    assert window.browsers == ()


def test_a_browser_is_drawn_for_as_long_as_it_stays(world: Any) -> None:
    server, window = world
    server.clients[1] = client = Client(1)
    server.told_of_coming(client)
    (browser,) = window.browsers
    assert soon(lambda: browser.pictures > 0)
    server.leave(client)
    assert window.browsers == ()
    count = browser.pictures
    time.sleep(2.5 * window_module.IDLE_S)
    assert browser.pictures <= count + 1  # one may have been on its way


# -- refusals --------------------------------------------------------------------------------------


def test_a_refusal_is_kept_with_the_step_that_was_open_and_fields_are_shown_anew(
    world: Any,
) -> None:
    server, window = world
    server.clients[1] = client = Client(1)
    server.told_of_coming(client)
    (browser,) = window.browsers
    error = InvalidInputError("radius_mm must be 5 to 45, not 3: choose another")
    window.bindings.refuse(error, SimpleNamespace(client=client))
    assert soon(lambda: browser.pictures and browser.newest.refused == 1)
    (refusal,) = browser.newest.refusals
    assert refusal.where == "3 Pointer"
    assert refusal.title == "Invalid value"
    assert refusal.body.endswith("must be 5 to 45, not 3: choose another")
    assert client.notices == []


def test_a_job_that_failed_is_kept_with_its_step_and_one_that_was_cancelled_is_not(
    world: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    server, window = world
    server.clients[1] = client = Client(1)
    server.told_of_coming(client)
    (browser,) = window.browsers
    assert soon(lambda: browser.pictures > 0)
    words = "18.5 degrees one way, 0.31 the other: swing in two directions"
    failed = JobStatus(
        "a", "StartPointerCapture", "failed", 0.5, error_code="degenerate_geometry", error=words
    )
    ended = JobStatus(
        "b", "StartScan", "cancelled", 0.5, error_code="cancelled", error="the user cancelled"
    )
    for status in (failed, ended):
        monkeypatch.setattr(window_module, "_newest", lambda bench, status=status: status)
        window.wake()
        assert soon(lambda status=status: status.id in window._reported)
    window.wake()
    assert soon(lambda: browser.newest.refusals)
    (refusal,) = browser.newest.refusals
    assert refusal.where == "3 Pointer, Pivoting the pointer"
    assert refusal.body == words
    assert refusal.title == "Data not sufficient"
    assert client.notices == []


# -- comparisons -----------------------------------------------------------------------------------


def test_a_browser_is_shown_the_comparison_that_it_started_once_the_job_is_done(world: Any) -> None:
    server, window = world
    server.clients[1] = client = Client(1)
    server.told_of_coming(client)
    (browser,) = window.browsers
    found = MapComparison("bone.ply", None, MapErrors({}), ())  # type: ignore[arg-type]
    go = threading.Event()

    def work(progress: Any, cancel: Any) -> Ended:
        go.wait(60.0)
        return Ended(0, found)

    jobs = window._hub.get().jobs
    others = jobs.start(StartComparison("bone.ply"), work, device=False)
    started = jobs.start(StartComparison("bone.ply"), work, device=False)
    browser.view = ViewState(step="maps", comparison=started.id)
    window.wake()
    assert soon(lambda: browser.pictures and browser.newest.view is browser.view)
    assert browser.newest.compared is None
    go.set()
    assert soon(lambda: browser.newest.compared is found)
    jobs.wait(others.id, 60.0)
    browser.view = ViewState(step="maps")
    window.wake()
    assert soon(lambda: browser.newest.view is browser.view)
    assert browser.newest.compared is None


# -- real websockets -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")  # what is built for nobody goes nowhere
def test_short_visits_leave_nobody_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Browsers that stay a moment only, by the way that real ones come."""
    begun: list[int] = []
    ended: list[int] = []

    class Counted(Browser):
        def __init__(self, client: Any, *rest: Any) -> None:
            begun.append(client.client_id)
            try:
                super().__init__(client, *rest)
            finally:
                ended.append(client.client_id)

    monkeypatch.setattr(window_module, "Browser", Counted)
    with served(tmp_path) as (port, window):
        for stay_s in (0.0, 0.05, 0.1, 0.2):
            asyncio.run(visit(port, lambda stay_s=stay_s: asyncio.sleep(stay_s)))
        assert begun
        assert stays(lambda: len(ended) == len(begun) and window.browsers == ())


@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")
def test_a_page_that_connects_anew_goes_on_as_it_was(tmp_path: Path) -> None:
    with served(tmp_path) as (port, window):
        views = []
        for name, step in (("a", "roll"), ("a", None), ("a", "path"), ("b", None)):
            views.append(asyncio.run(visit(port, lambda n=name, s=step: looks(window, n, s))))
            assert soon(lambda: window.browsers == ())
    first, second, third, stranger = views
    assert first.step == "roll"
    assert second.step == "roll"
    assert third.step == "path"  # somebody was quicker than the page with its name
    assert stranger.step == "setup"


async def looks(window: Window, name: str, step: Any) -> ViewState:
    """Return how a page with a name looks at the session, after it chose a step or none."""
    for _ in range(1000):
        if any(browser._drawn for browser in window.browsers):
            break
        await asyncio.sleep(0.02)
    (browser,) = window.browsers
    if step is not None:
        browser.change_view(lambda v: replace(v, step=step))
    browser._service(f"resume:{name}", SimpleNamespace(client=browser.client), None)
    return browser.view


@contextlib.contextmanager
def served(sessions: Path) -> Generator[tuple[int, Window]]:
    """Serve a new session to browsers at a port."""
    hub, gateway = build_registry(sessions, processes=False), ViewerGateway()
    hub.create()
    window = Window(gateway.server, hub)
    settings = ServerSettings(port=0, sessions=sessions, token=TOKEN, open_browser=False)
    server = server_of(hub, gateway, settings)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        assert soon(lambda: server.started)
        yield server.servers[0].sockets[0].getsockname()[1], window
    finally:
        server.should_exit = True
        thread.join(20.0)
        window.close()
        gateway.close()
        hub.close_all()


def stays(condition: Any, for_s: float = 1.0, within_s: float = 30.0) -> bool:
    """Return whether a condition comes to hold, and holds on."""
    end, since = time.monotonic() + within_s, None
    while time.monotonic() < end:
        now_s = time.monotonic()
        since = (since or now_s) if condition() else None
        if since is not None and now_s - since > for_s:
            return True
        time.sleep(0.02)
    return False


async def visit(port: int, stay: Callable[[], Awaitable[Any]]) -> Any:
    """Connect as a browser does, say where the camera is, stay, and leave."""
    async with websockets.asyncio.client.connect(
        f"ws://127.0.0.1:{port}/viewer",
        subprotocols=[websockets.Subprotocol(f"viser-v{viser.__version__}")],
        additional_headers={"Authorization": f"Bearer {TOKEN}"},
        proxy=None,
        max_size=None,
    ) as socket:
        await asyncio.wait_for(socket.recv(), 20.0)
        await socket.send(msgspec.msgpack.encode(CAMERA))
        return await stay()
