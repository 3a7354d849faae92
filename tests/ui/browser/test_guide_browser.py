"""The guided demo in a real browser: it begins, waits, goes on, and leaves a session behind."""

import re
import time
from pathlib import Path

import pytest

from rona_core.app.procedure import PROCEDURE
from tests.helpers.ui.browser_driver import Surgeon, wait_for

GUIDE = Path(__file__).parents[3] / "static" / "page" / "sessions" / "guide.js"
READ_S = 3.5  # that a caption stands before its message is sent


def told(surgeon: Surgeon) -> str:
    return surgeon.page.locator("#guidestep").inner_text()


@pytest.mark.browser
@pytest.mark.slow
def test_it_plays_step_by_step_waits_when_it_is_paused_and_keeps_what_was_done(
    surgeon: Surgeon,
) -> None:
    page, pause = surgeon.page, surgeon.page.locator("#guidepause")
    others = {job["id"] for job in surgeon.ask("/jobs")}  # of sessions before, on the same server

    def activities() -> list[str]:
        return [job["activity"] for job in surgeon.ask("/jobs") if job["id"] not in others]

    page.locator("#logo").click()
    page.locator("#homeguide").click()
    wait_for(lambda: told(surgeon).startswith("1 of "), "the first step")
    assert told(surgeon).endswith("Tool")
    assert surgeon.ask("/sessions/current")["name"] == "Guided demo"
    pause.click()  # while the caption of the tool is read
    time.sleep(READ_S + 1.5)
    assert activities() == []
    assert pause.inner_text() == "Go on"
    surgeon.picture("guide")
    pause.click()
    wait_for(lambda: told(surgeon).startswith("2 of "), "the second step")
    surgeon.frame.locator(".r-title").get_by_text("Step 3: Pointer", exact=True).wait_for()
    wait_for(lambda: activities()[-1] == "StartPointerCapture", "its job")
    page.locator("#guideend").click()
    assert page.locator("#guide").is_hidden()
    surgeon.wait_state("Pointer", "done")  # it ends by itself
    time.sleep(READ_S + 1.5)
    assert activities() == ["StartToolCapture", "StartPointerCapture"]
    assert surgeon.states()[1:4] == ["done", "done", "ready"]
    assert surgeon.errors == []


def test_every_message_of_the_procedure_has_a_caption() -> None:
    captions = re.findall(r"^  (\w+): \"", GUIDE.read_text("utf-8"), re.MULTILINE)
    assert sorted(captions) == sorted({type(stage.message).__name__ for stage in PROCEDURE})
