"""RONA in a real headless Chromium: a server of its own, and hands that only click and type."""

import os
import re
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from rona_ui.resources import demo_session

REPOSITORY = Path(__file__).resolve().parents[3]
CHROMIUM = Path(os.environ.get("RONA_CHROMIUM", "/usr/bin/chromium"))
TOKEN = "token-of-the-browser-test"
PATIENCE_S = 120.0  # how long anything may take on the slowest machine: a claim of speed says so
PAUSE_S = 0.6  # longer than a dragged field takes to settle
STEPS = (
    "Set-up",
    "Tool",
    "Pointer",
    "Surface",
    "Path",
    "Smoothing",
    "Roll",
    "Scan",
    "Maps",
    "Implant bed",
)
MADE = ("done", "✖ fail")  # badges of a step that was done
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--ignore-gpu-blocklist",
)  # fmt: skip
DRAWN_BY = {
    "mesa": ("--use-gl=angle", "--use-angle=gl-egl"),
    "swiftshader": ("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
}
PICTURES = os.environ.get("RONA_SCREENSHOTS") == "1"
VIEWPORT = {"width": 1600, "height": 1000}  # of the pictures
SMALL = {"width": 1360, "height": 850}  # quicker to draw
# no graphics card is here, and drawing took more of the processor than all that is tested: the
# scene in one pixel of 16 and ten times a second, beside panels that are as ever
COARSE = """(() => {
  const get = URLSearchParams.prototype.get, frame = window.requestAnimationFrame;
  let last = -Infinity;
  URLSearchParams.prototype.get = function (name) {
    return name === 'fixedDpr' ? '0.25' : get.call(this, name);
  };
  window.requestAnimationFrame = (call) => frame((now) => {
    if (now <= last || now - last >= 100) { last = now; call(now); }
    else setTimeout(() => frame((later) => { last = later; call(later); }), last + 100 - now);
  });
})()"""

PROJECT = """(places) => {
  const m = window.__viserMutable, node = m.nodeRefFromName['/skull'];
  node.updateWorldMatrix(true, false);
  m.camera.updateMatrixWorld();
  const box = m.canvas.getBoundingClientRect();
  return places.map((p) => {
    const v = node.position.clone().set(p[0] / 1000, p[1] / 1000, p[2] / 1000);
    v.applyMatrix4(node.matrixWorld).project(m.camera);
    return [box.left + (v.x + 1) / 2 * box.width, box.top + (1 - v.y) / 2 * box.height];
  });
}"""
SESSION = "() => JSON.parse(document.querySelector('[data-page]').dataset.state).session"
OPEN_DEMO = "async () => (await (await fetch('/api/v1/sessions/demo', {method: 'POST'})).json()).id"
PUT = """async ([path, body]) => (await fetch('/api/v1/sessions/current' + path, {method: 'POST',
  headers: {'Content-Type': 'application/json'}, body: JSON.stringify(body)})).status"""
CLOSE = "async (id) => (await fetch(`/api/v1/sessions/${id}`, {method: 'DELETE'})).status"
ASK = "async (path) => (await fetch('/api/v1' + path)).json()"
STATES = """() => [...document.querySelectorAll('.r-step .r-badge')].map((e) => e.textContent)"""
# names of what is to be seen; parents that stay behind, empty, when their last child goes do not
# count
NODES = """() => {
  const state = window.__viserSceneTree.getState();
  const all = Object.keys(state).filter((name) => state[name].effectiveVisibility !== false);
  const empty = ['/drawing', '/pointer', '/maps', '/path', '/scan', '/rolls', '/surface',
    '/edit', '/pattern', '/places', '/places/best', '/places/smallest',
    '/margins', '/obstacles', '/second', '/references', '/implant', '/bed', '/milling',
    '/chance', '/head', '/sight', '/labels', '/landmarks', '/landmarks/label',
    '/robot', '/tracker'];
  return all.filter((n) => !empty.includes(n)).sort();
}"""


def free_port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def running_browser() -> Iterator[Any]:
    """Run a headless Chromium; without one the tests are skipped, or fail under ``CI``."""
    if not CHROMIUM.is_file():
        reason = (
            f"no browser at {CHROMIUM}: see tests/tools/install_browser.sh, or set RONA_CHROMIUM"
        )
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    playwright = pytest.importorskip("playwright.sync_api")
    flags = (*FLAGS, *DRAWN_BY[os.environ.get("RONA_E2E_GL", "mesa")])
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(flags))
        yield browser
        browser.close()


@contextmanager
def running_server(
    sessions: Path,
    pace: float | None = None,
    file: Path | None = None,
    more: Sequence[str] = (),
) -> Iterator[str]:
    """Run `rona serve` on a free port with a file open; yields the session's address.

    Captures are shown at its own or another pace. Without a file it is a copy of the demo; ``more``
    are further arguments.
    """
    port = free_port()
    environment = {**os.environ, "RONA_TOKEN": TOKEN, "OMP_NUM_THREADS": "1"}
    log = (sessions / "server.log").open("wb")
    arguments = ["serve", str(file or demo_session()), "--no-open"]
    arguments += ["--port", str(port), "--sessions", str(sessions)]
    arguments += [*([] if pace is None else ["--pace", str(pace)]), *more]
    server = subprocess.Popen(
        [sys.executable, "-m", "rona_ui", *arguments],
        cwd=REPOSITORY,
        env=environment,
        stdout=log,
        stderr=log,
    )
    address = f"http://127.0.0.1:{port}/"
    try:
        wait_for(lambda: answers(address) or server.poll() is not None, "the server")
        if server.poll() is not None:
            raise RuntimeError((sessions / "server.log").read_text())
        yield f"{address}session?token={TOKEN}"
    finally:
        server.terminate()
        try:
            server.wait(20)
        except subprocess.TimeoutExpired:
            server.kill()
            server.wait(20)
        log.close()
    told = (sessions / "server.log").read_text()
    assert "Traceback" not in told, told  # a defect that a page did not show


def answers(address: str) -> bool:
    """Return whether a server is there."""
    try:
        urllib.request.urlopen(address, timeout=2.0).close()
    except urllib.error.HTTPError:
        return True  # it asks for the token, so it is there
    except OSError:
        return False
    return True


def wait_for(condition: Callable[[], Any], what: str, timeout_s: float = PATIENCE_S) -> Any:
    """Return the first true value of ``condition()``; fail after the timeout."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        if value := condition():
            return value
        time.sleep(0.05)
    raise AssertionError(f"waited {timeout_s:.0f} s for {what}")


@contextmanager
def surgeon_at(browser: Any, address: str, pictures: Path) -> Iterator["Surgeon"]:
    """Open a page and sit down before it; close it afterwards."""
    page = browser.new_page(viewport=VIEWPORT if PICTURES else SMALL)
    page.set_default_timeout(PATIENCE_S * 1000)
    if not PICTURES:
        page.add_init_script(COARSE)
    yield Surgeon(page, address, pictures)
    page.close()


class Surgeon:
    """Eyes, mouse and keyboard before the page."""

    def __init__(self, page: Any, address: str, pictures: Path) -> None:
        self.page, self.address, self.pictures = page, address, pictures
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.connections: list[str] = []  # of the viewer, in the order they came and went
        page.on("websocket", self._connected)
        self.come()

    def come(self) -> None:
        """Open the page and wait for steps and scene."""
        self.page.goto(self.address)
        self.frame = wait_for(self._viewer, "the viewer's frame")
        self.frame.wait_for_function(
            "() => window.__viserSceneTree && '/skull' in window.__viserSceneTree.getState()"
            " && document.querySelectorAll('.r-step').length == 10",
            timeout=PATIENCE_S * 1000,
        )
        self.page.locator("#splash").wait_for(state="hidden")
        close = self.frame.locator(".mantine-Notification-root button")
        for _ in range(close.count()):  # tells of software rendering, and covers the scene
            close.first.click()

    def open_demo(self) -> None:
        """Open the demo session as it is on file, beside the sessions that are open."""
        made = self.page.evaluate(OPEN_DEMO)
        self.wait_session(made)
        wait_for(lambda: self.states() == ["done"] * len(STEPS), "its steps")

    def close_others(self) -> None:
        """Close all sessions but the one that is shown."""
        shown = self.ask("/sessions/current")["id"]
        for other in self.ask("/sessions")["sessions"]:
            if other["id"] != shown:
                assert self.page.evaluate(CLOSE, other["id"]) == 204

    def wait_session(self, key: str) -> None:
        """Wait until the docks show a session: until then a step may be that of the one before."""
        wait_for(lambda: self.frame.evaluate(SESSION) == key, "the session in the docks")

    def _connected(self, socket: Any) -> None:
        at = time.monotonic()
        self.connections.append("came")
        socket.on("close", lambda _: self.connections.append(f"{time.monotonic() - at:.1f} s"))

    def _viewer(self) -> Any:
        return next((f for f in self.page.frames if "/viewer" in f.url), None)

    def button(self, name: str) -> Any:
        """Return a button by the beginning of its words."""
        return self.frame.get_by_role("button", name=re.compile(f"^{re.escape(name)}")).first

    def field(self, label: str) -> Any:
        """Return the input beside a label that is seen, by the beginning of its words."""
        beside = "xpath=ancestor::div[contains(@class, 'mantine-Flex-root')][1]//input"
        begin = re.compile(f"^{re.escape(label)}")
        words = self.frame.locator("label").filter(has_text=begin, visible=True).first
        return words.locator(beside).first

    def open_step(self, name: str) -> None:
        """Click a step of the list."""
        title = f"Step {STEPS.index(name) + 1}: {name}"
        self.button(title).click()
        titles = self.frame.locator(".r-title")
        try:
            wait_for(titles.get_by_text(title, exact=True).count, "the step to open")
        except AssertionError as error:
            shown = titles.all_inner_texts()
            told = f"{shown} is open, connections {self.connections}, errors {self.errors}"
            raise AssertionError(f"{title} does not open: {told}") from error

    def menu(self, name: str, entry: str | None = None) -> None:
        """Open a menu of the tool bar, and click an entry by the beginning of its words."""
        self.page.locator(f"#{name}").click()
        menu = self.page.locator(f"#{name}menu")
        menu.wait_for()
        if entry is not None:
            words = re.compile(f"^●?{re.escape(entry)}")
            menu.locator(".entry").filter(has_text=words).first.click()

    def command(self, words: str) -> None:
        """Carry out a command by the palette."""
        self.page.keyboard.press("Control+k")
        self.page.locator("#palettefield").fill(words)
        self.page.keyboard.press("Enter")

    def saved(self) -> str:
        """Return what the bar says of the session's file."""
        return self.page.locator("#saved").inner_text()

    def tab(self, name: str) -> None:
        """Click a tab of the right dock."""
        self.frame.get_by_role("tab", name=name).click()

    def states(self) -> list[str]:
        """Return the badge of each step, once none is being judged any more."""
        found: list[str] = []

        def judged() -> bool:
            found[:] = self.frame.evaluate(STATES)
            return "judging" not in found

        wait_for(judged, "the steps to be judged")
        return found

    def wait_state(self, name: str, state: str) -> None:
        """Wait until a step has a state; one that is made counts as done, whatever its figures."""
        index = STEPS.index(name)
        wanted = MADE if state == "done" else (state,)
        wait_for(lambda: self.states()[index] in wanted, f"{name} to be {state}")

    def wait_idle(self) -> None:
        """Wait until no job is under way."""
        wait_for(lambda: not self.button("Cancel").is_visible(), "the job to end")

    def nodes(self) -> list[str]:
        """Return the names of the scene's nodes."""
        return self.frame.evaluate(NODES)

    def ask(self, path: str) -> Any:
        """Return what the program answers to a question of the page, over REST."""
        return self.page.evaluate(ASK, path)

    def pixels(self, places_base: list[tuple[float, float, float]]) -> list[tuple[float, float]]:
        """Return where places in base (mm) are on the page."""
        inside = self.frame.evaluate(PROJECT, [list(p) for p in places_base])
        box = self.page.locator("iframe#viewer").bounding_box()
        left, top = box["x"], box["y"]
        return [(left + x, top + y) for x, y in inside]

    def picture(self, name: str) -> Path:
        """Keep what is to be seen now."""
        time.sleep(0.5)  # the picture, not a condition: the last frame is drawn on demand
        path = self.pictures / f"{name}.png"
        self.page.screenshot(path=path)
        return path


def put(surgeon: Surgeon, path: str, body: Any) -> None:
    """Send something to the current session over REST."""
    assert surgeon.page.evaluate(PUT, [path, body]) < 300


def retype(surgeon: Surgeon, field: Any, text: str) -> None:
    """Type over what a field holds, as slowly as somebody who thinks."""
    field.click()
    surgeon.page.keyboard.press("Control+a")
    first, rest = text[:1], text[1:]
    surgeon.page.keyboard.type(first)
    time.sleep(PAUSE_S)
    surgeon.page.keyboard.type(rest)


def shows(field: Any, text: str) -> Any:
    """Wait until a field shows a text."""
    return wait_for(lambda: field.input_value() == text, f"the field to show {text}")
