"""Animated picture of the guided demo, for the README.

``python -m tests.tools.animation [FILE]`` plays it in a real browser and keeps a few frames a step.
"""

import io
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tests.helpers.ui.browser_driver import (
    PATIENCE_S,
    REPOSITORY,
    Surgeon,
    running_browser,
    running_server,
    wait_for,
)

FILE = REPOSITORY / "docs" / "images" / "procedure.webp"
SEEN = {"width": 1280, "height": 720}
SIZE = (960, 540)  # of the picture
PACE = 30.0  # times real time, of what moves
MOST = 6  # frames a step
FIRST_MS, MOVE_MS, LAST_MS = 700, 110, 300  # how long the first, the middle and the last are shown
END_MS = 2500
QUALITY = 62
LARGE = """#guide { font-size: 17px; } #guide .guidestep { font-size: 15px; }
#guide .choices { display: none; }"""
READ = ("READ_MS = 3500", "READ_MS = 900")  # nobody reads while it is recorded
LOOK_MS = 200  # between two frames
REST_MS = 4000  # until nothing moves any more
END = "The whole procedure"  # what the guide says then

Frames = dict[str, list[Image.Image]]  # by what the guide says of the step, in their order


def play(surgeon: Surgeon) -> Frames:
    """Play the guided demo to its end, and keep what is seen of each step."""
    page, frames = surgeon.page, {}
    page.add_style_tag(content=LARGE)
    page.locator("#logo").click()
    page.locator("#homeguide").click()
    told = page.locator("#guidestep")
    wait_for(lambda: told.inner_text().startswith("1 of "), "the first step")
    while told.inner_text() != END:
        frames.setdefault(told.inner_text(), []).append(seen(page))
        page.wait_for_timeout(LOOK_MS)
    page.wait_for_timeout(REST_MS)
    frames[END] = [seen(page)]
    return frames


def quickly(route: Any) -> None:
    """Hand the guide on with shorter times to read its captions."""
    told = route.fetch()
    text = told.text()
    assert READ[0] in text
    route.fulfill(response=told, body=text.replace(*READ))


def seen(page: Any) -> Image.Image:
    """Return what is to be seen now, in the size of the picture."""
    shot = page.screenshot(type="jpeg", quality=92, timeout=PATIENCE_S * 1000)
    return Image.open(io.BytesIO(shot)).convert("RGB").resize(SIZE, Image.Resampling.LANCZOS)


def chosen(frames: Frames) -> tuple[list[Image.Image], list[int]]:
    """Return the frames to be shown and for how many milliseconds each."""
    pictures: list[Image.Image] = []
    times: list[int] = []
    for name, each in frames.items():
        kept = np.unique(np.linspace(0, len(each) - 1, MOST).round().astype(int))
        pictures += [each[index] for index in kept]
        times += [FIRST_MS, *[MOVE_MS] * (len(kept) - 1)]
        times[-1] = END_MS if name == END else max(times[-1], LAST_MS)
    return pictures, times


def main(file: Path) -> None:
    """Play, and write the picture."""
    with (
        tempfile.TemporaryDirectory() as sessions,
        running_browser() as browser,
        running_server(Path(sessions), PACE) as address,
    ):
        page = browser.new_page(viewport=SEEN)
        page.set_default_timeout(PATIENCE_S * 1000)
        page.route("**/sessions/guide.js", quickly)
        pictures, times = chosen(play(Surgeon(page, address, file.parent)))
    first, *rest = pictures
    options = {"duration": times, "loop": 0, "quality": QUALITY, "method": 4}
    first.save(file, save_all=True, append_images=rest, **options)
    print(f"{file}: {len(times)} frames, {sum(times) / 1000:.1f} s, {file.stat().st_size} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
