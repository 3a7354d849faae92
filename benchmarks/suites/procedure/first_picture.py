"""Time to the first picture of the page, and its bytes: a program of its own, not a suite.

``python -m benchmarks.suites.procedure.first_picture`` takes them
beside an empty page of viser, in the same browser and run; needs the browser of the tests.
"""

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import viser

from tests.helpers.ui.browser_driver import PATIENCE_S, running_browser, running_server

VISITS = 3  # each; the median counts
SEEN = {"width": 1360, "height": 850}
EMPTY = """() => new Promise((done) => {
  const look = () => (window.__viserMutable?.camera && window.__viserSceneTree
    ? requestAnimationFrame(() => requestAnimationFrame(done)) : setTimeout(look, 20));
  look();
})"""


class Visit:
    """One load of a page, in a browser without anything kept."""

    def __init__(self, browser: Any, address: str, there: Callable[[Any], None]) -> None:
        context = browser.new_context(viewport=SEEN)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_S * 1000)
        self.socket_bytes, self.http_bytes = 0, 0
        page.on("websocket", self._follow)
        network = context.new_cdp_session(page)
        network.send("Network.enable")
        network.on("Network.loadingFinished", self._load)
        begun_s = time.monotonic()
        page.goto(address)
        there(page)
        self.seconds = time.monotonic() - begun_s
        page.wait_for_timeout(3000)  # what comes behind the first picture counts as well
        context.close()

    def _follow(self, socket: Any) -> None:
        socket.on("framereceived", self._count)

    def _count(self, data: str | bytes) -> None:
        self.socket_bytes += len(data)

    def _load(self, event: Any) -> None:
        self.http_bytes += int(event["encodedDataLength"])


def uncovered(page: Any) -> None:
    """Wait until the cover is gone: the picture is on the screen."""
    page.locator("#splash").wait_for(state="attached")
    page.locator("#splash").wait_for(state="hidden")


def main() -> None:
    """Print the figures."""
    with tempfile.TemporaryDirectory() as folder, running_browser() as browser:
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        empty_at = f"http://127.0.0.1:{server.get_port()}"
        with running_server(Path(folder)) as address:
            Visit(browser, empty_at, lambda page: page.evaluate(EMPTY))  # shaders, caches
            empty = [
                Visit(browser, empty_at, lambda page: page.evaluate(EMPTY)) for _ in range(VISITS)
            ]
            ours = [Visit(browser, address, uncovered) for _ in range(VISITS)]
        server.stop()
    for name, visits in (("empty viser page", empty), ("RONA", ours)):
        seconds = [visit.seconds for visit in visits]
        sizes = statistics.median(v.socket_bytes for v in visits) / 1e6
        pages = statistics.median(v.http_bytes for v in visits) / 1e6
        told = ", ".join(f"{s:.2f}" for s in seconds)
        print(f"{name}: first picture {told} s; socket {sizes:.2f} MB, pages {pages:.2f} MB")
    ratio = statistics.median(v.seconds for v in ours) / statistics.median(v.seconds for v in empty)
    print(f"ratio {ratio:.2f} (goal 2.5)")


if __name__ == "__main__":
    main()
