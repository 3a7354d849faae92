"""Times of the page beside those of an empty page of viser: a program of its own, not a suite.

``python -m benchmarks.suites.procedure.browser_times`` takes the time to the first picture and its
bytes, and the time from a click to what it shows, in the same browser and run, of the demo and of
the demo with so many strokes of the pointer that its cloud has 200 000 points; it needs the browser
of the tests. For the clicks the scene is drawn at a twentieth of its resolution: what counts is the
program, not the software that stands in for a graphics card.
"""

import statistics
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import viser

from benchmarks.reference.yardstick import REFERENCE_S, yardstick_s
from benchmarks.reliability.server_process import cpu_s_of
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.surface.messages import BuildSurface
from rona_core.compose import new_workbench
from rona_core.session.files import load_session, save_session
from rona_ui.resources import demo_session
from tests.helpers.ui.browser_driver import PATIENCE_S, PUT, running_browser, running_server

VISITS = 5  # each, in turns; the median counts
ROUNDS = 4  # through the steps; the first one builds their fields
MANY_POINTS = 200_000
SEEN = {"width": 1360, "height": 850}
EMPTY = """() => new Promise((done) => {
  const look = () => (window.__viserMutable?.camera && window.__viserSceneTree
    ? requestAnimationFrame(() => requestAnimationFrame(done)) : setTimeout(look, 20));
  look();
})"""
COARSE = """(() => {
  const get = URLSearchParams.prototype.get;
  URLSearchParams.prototype.get = function (name) {
    return name === 'fixedDpr' ? '0.05' : get.call(this, name);
  };
})()"""
# clicks a button of the docks; resolves with the milliseconds until the words are there
CLICK = """([button, where, words]) => new Promise((done) => {
  const buttons = [...document.querySelectorAll('button')];
  const found = buttons.find((each) => each.textContent.trim() === button);
  const there = () => [...document.querySelectorAll(where)].some(
    (each) => each.textContent.trim() === words);
  const begun = performance.now();
  new MutationObserver((changes, self) => {
    if (!there()) return;
    self.disconnect();
    done(performance.now() - begun);
  }).observe(document.body, { subtree: true, childList: true, characterData: true });
  found.click();
})"""
RATIO_GOAL = 2.5
SERVER_GOAL_MS = 30.0
GOALS_MS = {"at rest": 100.0, "while a job runs": 150.0}


def first_picture_s(browser: Any, address: str, there: Callable[[Any], None]) -> float:
    """Return the seconds until a page is there, in a browser without anything kept."""
    context = browser.new_context(viewport=SEEN)
    page = context.new_page()
    page.set_default_timeout(PATIENCE_S * 1000)
    begun_s = time.monotonic()
    page.goto(address)
    there(page)
    took_s = time.monotonic() - begun_s
    context.close()
    return took_s


class Bytes:
    """What one load of a page brings; to count it takes time, so this is a visit of its own."""

    def __init__(self, browser: Any, address: str, there: Callable[[Any], None]) -> None:
        self.socket, self.http = 0, 0
        context = browser.new_context(viewport=SEEN)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_S * 1000)
        page.on("websocket", self._follow)
        network = context.new_cdp_session(page)
        network.send("Network.enable")
        network.on("Network.loadingFinished", self._load)
        page.goto(address)
        there(page)
        page.wait_for_timeout(3000)  # what comes behind the first picture counts as well
        context.close()

    def _follow(self, socket: Any) -> None:
        socket.on("framereceived", self._receive)

    def _receive(self, data: str | bytes) -> None:
        self.socket += len(data)

    def _load(self, event: Any) -> None:
        self.http += int(event["encodedDataLength"])


def drawn(page: Any) -> None:
    """Wait until an empty page is drawn."""
    page.evaluate(EMPTY)


def uncovered(page: Any) -> None:
    """Wait until the cover is gone: the picture is on the screen."""
    page.locator("#splash").wait_for(state="attached")
    page.locator("#splash").wait_for(state="hidden")


@dataclass(frozen=True, slots=True)
class Clicks:
    """Milliseconds from clicks to what they show."""

    empty: list[float]
    first: list[float]  # on a step whose fields are not there yet
    again: dict[str, list[float]]  # by what goes on meanwhile
    server_ms: float  # CPU of the server of one click at rest, on a step that was seen before
    many: list[float]  # again, at rest, with many points in the scene


def empty_clicks(page: Any) -> list[float]:
    """Return the times on the empty page: a button that counts its clicks."""
    page.evaluate(EMPTY)
    page.get_by_role("button", name="Count").wait_for()
    return [
        page.evaluate(CLICK, ["Count", ".counted", f"{number} clicks"])
        for number in range(1, ROUNDS * len(REGISTRY.step_names))
    ]


def server_cpu_s(address: str) -> float:
    """Return the CPU time so far of the server at an address, a child of this program."""
    port = str(urlsplit(address).port)
    children = Path(f"/proc/self/task/{threading.get_native_id()}/children").read_text().split()
    for child in children:
        if port in Path(f"/proc/{child}/cmdline").read_text().split("\0"):
            return cpu_s_of(int(child))
    raise RuntimeError(f"no server of this program is at {address}")


def step_clicks(
    page: Any, address: str, job: bool
) -> tuple[list[float], dict[str, list[float]], float]:
    """Return the times from a click on a step to its title: for the first time, and again.

    With ``job`` also while the pointer sweeps. Then the server's milliseconds of a click at rest.
    """
    uncovered(page)
    page.wait_for_timeout(1000)
    docks = next(frame for frame in page.frames if "/viewer" in frame.url)
    titles = [
        f"Step {number}: {REGISTRY.lines[name].title}"
        for number, name in enumerate(REGISTRY.step_names, start=1)
    ]

    def visit(title: str) -> float:
        took_ms = docks.evaluate(CLICK, [title, ".r-title", title])
        page.wait_for_timeout(300)  # as long as somebody looks, at least
        return took_ms

    first = [visit(title) for title in (*titles[1:], titles[0])]
    before_s = server_cpu_s(address)
    again = {"at rest": [visit(title) for _ in range(ROUNDS - 1) for title in titles[1:]]}
    server_ms = 1000.0 * (server_cpu_s(address) - before_s) / len(again["at rest"])
    if job:
        if page.evaluate(PUT, ["/jobs/StartSurfaceCapture", {}]) >= 300:
            raise RuntimeError("no job was started")
        again["while a job runs"] = [visit(title) for title in titles[1:]]
    return first, again, server_ms


def take_clicks(browser: Any, empty_at: str, address: str, many_at: str) -> Clicks:
    """Take the times of clicks on the pages."""

    def take(place: str, clicks: Callable[[Any], Any]) -> Any:
        page = browser.new_page(viewport=SEEN)
        page.set_default_timeout(PATIENCE_S * 1000)
        page.add_init_script(COARSE)
        page.goto(place)
        taken = clicks(page)
        page.close()
        return taken

    _, many, _ = take(many_at, lambda page: step_clicks(page, many_at, job=False))
    first, again, server_ms = take(address, lambda page: step_clicks(page, address, job=True))
    return Clicks(take(empty_at, empty_clicks), first, again, server_ms, many["at rest"])


def file_of_many_points(folder: Path) -> Path:
    """Save the demo with its stroke of the pointer so often that the cloud has many points."""
    demo = load_session(demo_session())
    (stroke,) = demo.captures.surface
    times = -(-MANY_POINTS // len(stroke.marker.times_s))
    strokes = tuple(replace(stroke, ordinal=stroke.ordinal + 1000 * n) for n in range(times))
    bench = new_workbench(replace(demo, captures=replace(demo.captures, surface=strokes)))
    bench.dispatch(BuildSurface())
    path = folder / "many points.rona"
    save_session(bench.session, path)
    bench.close()
    return path


def empty_server() -> viser.ViserServer:
    """Return a server of viser with a button that counts its clicks, and nothing else."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    button, words, number = server.gui.add_button("Count"), server.gui.add_html(""), [0]

    @button.on_click
    def _(event: Any) -> None:
        number[0] += 1
        words.content = f'<div class="counted">{number[0]} clicks</div>'

    return server


def main() -> None:
    """Print the figures."""
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.TemporaryDirectory() as other,
        running_browser() as browser,
        running_server(Path(folder)) as address,
        running_server(Path(other), file=file_of_many_points(Path(other))) as many_at,
    ):
        server = empty_server()
        empty_at = f"http://127.0.0.1:{server.get_port()}"
        pages = {
            "empty viser page": (empty_at, drawn),
            "RONA": (address, uncovered),
            f"RONA, {MANY_POINTS:,} points": (many_at, uncovered),
        }
        sizes = {name: Bytes(browser, *page) for name, page in pages.items()}
        taken_s: dict[str, list[float]] = {name: [] for name in pages}
        for _ in range(VISITS):
            for name, page in pages.items():
                taken_s[name].append(first_picture_s(browser, *page))
        clicks = take_clicks(browser, empty_at, address, many_at)
        server.stop()
    empty_s = statistics.median(taken_s["empty viser page"])
    for name, seconds in taken_s.items():
        told = ", ".join(f"{s:.2f}" for s in seconds)
        size = f"socket {sizes[name].socket / 1e6:.2f} MB, pages {sizes[name].http / 1e6:.2f} MB"
        ratio = f"{statistics.median(seconds) / empty_s:.2f} x the empty page"
        print(f"{name}: first picture {told} s, {ratio} (goal {RATIO_GOAL}); {size}")
    slower = yardstick_s() / REFERENCE_S
    print(f"goals in ms hold for {REFERENCE_S:g} s a yardstick, here {slower:.1f} times as long")
    least_ms = statistics.median(clicks.empty)
    print(f"click, empty viser page: {least_ms:.0f} ms")
    print(f"click on a step for the first time: {statistics.median(clicks.first):.0f} ms")
    for name, goal_ms in GOALS_MS.items():
        print(f"click on a step {name}: {told_of(clicks.again[name], goal_ms, least_ms)}")
    print(f"the server's CPU of a click: {clicks.server_ms:.0f} ms (goal {SERVER_GOAL_MS:.0f})")
    many = told_of(clicks.many, GOALS_MS["at rest"], least_ms)
    print(f"click on a step at rest, {MANY_POINTS:,} points: {many}")


def told_of(times_ms: list[float], goal_ms: float, least_ms: float) -> str:
    """Return the median of times beside goal and empty page."""
    took_ms = statistics.median(times_ms)
    return f"{took_ms:.0f} ms (goal {goal_ms:.0f}), {took_ms / least_ms:.1f} x the empty page"


if __name__ == "__main__":
    main()
