"""Graphics that are lost are said within 3 s, and Reload brings the scene back as it was."""

import io
import time

import numpy as np
import pytest
from PIL import Image

from tests.helpers.ui.browser_driver import Surgeon, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.slow]
LOSE = """() => {
  const gl = window.__viserMutable.canvas.getContext('webgl2');
  window.lose = gl.getExtension('WEBGL_lose_context');
  window.lose.loseContext();
}"""


def lose(surgeon: Surgeon) -> float:
    """Take the graphics away; return how long it took until that is said, in s."""
    surgeon.frame.evaluate(LOSE)
    begin = time.monotonic()
    surgeon.page.locator("#graphicslost").wait_for(state="visible")
    return time.monotonic() - begin


def colours(surgeon: Surgeon) -> int:
    """Return how many colours the scene on the screen has."""
    picture = surgeon.frame.locator("canvas[data-engine]").screenshot()
    small = Image.open(io.BytesIO(picture)).convert("RGB").resize((60, 60))
    return len(np.unique(np.asarray(small).reshape(-1, 3), axis=0))


def test_lost_graphics_are_said_and_reload_brings_the_scene_back(surgeon: Surgeon) -> None:
    surgeon.open_step("Scan")
    surgeon.menu("layers", "Tracker")
    surgeon.page.keyboard.press("Escape")
    before, nodes = colours(surgeon), surgeon.nodes()
    assert before > 20
    box = surgeon.page.locator("#graphicslost")
    assert not box.is_visible()
    assert lose(surgeon) < 3.0
    assert surgeon.page.locator("#stop").is_enabled()
    surgeon.picture("graphics_lost")
    surgeon.page.locator("#graphicsreload").click()
    box.wait_for(state="hidden")
    surgeon.frame = wait_for(surgeon._viewer, "the viewer's frame")
    wait_for(lambda: surgeon.frame.evaluate("() => !!window.__viserSceneTree"), "the viewer")
    wait_for(lambda: surgeon.nodes() == nodes, "the scene as it was")
    wait_for(lambda: colours(surgeon) > before / 2, "the picture")
    title = surgeon.frame.locator(".r-title")
    assert title.get_by_text("Step 8: Scan", exact=True).count() == 1
    assert not box.is_visible()


def test_graphics_that_come_back_are_drawn_and_nothing_is_said_any_more(surgeon: Surgeon) -> None:
    before = colours(surgeon)
    lose(surgeon)
    surgeon.frame.evaluate("() => window.lose.restoreContext()")
    surgeon.page.locator("#graphicslost").wait_for(state="hidden")
    wait_for(lambda: colours(surgeon) > before / 2, "the picture")
    assert surgeon.errors == []
