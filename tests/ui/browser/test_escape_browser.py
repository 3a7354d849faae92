"""Esc in a real browser: it closes what is open, and stops the robot whatever is open."""

import re
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rona_core
from rona_core.robot.kinematics.catalog import robot_model
from rona_ui.resources import demo_session
from tests.helpers.ui.browser_driver import PAUSE_S, Surgeon, put, retype, shows, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def drawing(surgeon: Surgeon) -> bool:
    return surgeon.button("Finish stroke").is_visible()


def begin_drawing(surgeon: Surgeon) -> None:
    surgeon.open_step("Path")
    surgeon.button("Draw on the skull").click()
    surgeon.button("Finish stroke").wait_for()


def palette(surgeon: Surgeon) -> Any:
    return surgeon.page.locator("#palettefield")


def open_palette(surgeon: Surgeon) -> None:
    surgeon.page.keyboard.press("Control+k")
    palette(surgeon).wait_for()


def open_menu(surgeon: Surgeon) -> None:
    surgeon.open_step("Set-up")
    surgeon.field("Bone").click()
    surgeon.frame.get_by_role("option").filter(visible=True).first.wait_for()


def type_something(surgeon: Surgeon) -> None:
    surgeon.open_step("Tool")
    retype(surgeon, surgeon.field("Pivot poses"), "99")


def open_help(surgeon: Surgeon) -> None:
    surgeon.page.locator("#help").click()
    surgeon.page.locator("#helptext").wait_for()


def announced(surgeon: Surgeon) -> str:
    message = surgeon.page.locator("#message")
    return message.inner_text() if message.is_visible() else ""


def idle(surgeon: Surgeon) -> bool:
    return all(job["state"] != "running" for job in surgeon.ask("/jobs"))


def test_escape_at_rest_closes_one_thing_at_a_time_and_announces_no_stop(surgeon: Surgeon) -> None:
    page, keys = surgeon.page, surgeon.page.keyboard
    begin_drawing(surgeon)
    open_palette(surgeon)
    keys.press("Escape")
    palette(surgeon).wait_for(state="hidden")
    assert drawing(surgeon)
    open_help(surgeon)
    keys.press("Escape")
    page.locator("#helptext").wait_for(state="hidden")
    assert drawing(surgeon)
    field = surgeon.field("Duration")
    held = field.input_value()
    retype(surgeon, field, "77")
    keys.press("Escape")
    shows(field, held)
    assert drawing(surgeon)
    keys.press("Escape")  # nothing is open any more: the mode itself
    wait_for(lambda: not drawing(surgeon), "drawing to end")
    assert surgeon.button("Draw on the skull").is_visible()

    begin_drawing(surgeon)
    page.locator("#help").focus()  # outside of the viewer
    keys.press("Escape")
    wait_for(lambda: not drawing(surgeon), "drawing to end")
    open_menu(surgeon)
    keys.press("Escape")
    surgeon.frame.get_by_role("option").filter(visible=True).first.wait_for(state="hidden")
    search = {"n_rolls": 720, "roll_from_deg": 0.0, "roll_to_deg": 360.0}
    put(surgeon, "/jobs/StartRollSearch", search)  # nothing moves, so nothing of it may end
    keys.press("Escape")
    time.sleep(PAUSE_S)
    assert announced(surgeon) == ""
    assert not any(job["state"] == "cancelled" for job in surgeon.ask("/jobs"))
    page.locator("#stop").click()  # the red button stops always, and says so
    wait_for(lambda: announced(surgeon) == "Robot stopped", "the word of the stop")
    for job in surgeon.ask("/jobs"):
        page.evaluate("(id) => fetch('/api/v1/jobs/' + id, {method: 'DELETE'})", job["id"])
    wait_for(lambda: idle(surgeon), "the search to end")
    assert surgeon.errors == []


@pytest.mark.parametrize(
    "opened", [open_palette, open_menu, type_something, open_help, lambda surgeon: None]
)
def test_escape_stops_the_robot_that_moves_whatever_is_open(
    surgeon: Surgeon, opened: Callable[[Surgeon], None]
) -> None:
    page = surgeon.page
    wait_for(lambda: announced(surgeon) == "", "what was announced before to go")
    surgeon.open_demo()  # whole captures again
    moving = lambda: surgeon.ask("/sessions/current/robot/state")["moving"]  # noqa: E731
    opened(surgeon)  # first: while the robot moves, the fields rest
    put(surgeon, "/jobs/StartToolCapture", {})
    wait_for(moving, "the robot to move")
    assert announced(surgeon) == ""
    page.keyboard.press("Escape")
    wait_for(lambda: not moving(), "the robot to rest")
    wait_for(lambda: announced(surgeon) == "Robot stopped", "the word of the stop")
    wait_for(lambda: idle(surgeon), "the capture to end")
    assert not moving()
    assert surgeon.ask("/jobs")[-1]["state"] == "cancelled"
    assert surgeon.errors == []


def ascans_told(surgeon: Surgeon, ending: str) -> int:
    """Wait for the word of the scan step that ends so; return how many A-scans it tells of."""
    told = surgeon.frame.get_by_text(re.compile(rf"^\d+ A-scans in .*{ending}"))
    told.wait_for()
    found = re.match(r"\d+", told.inner_text())
    assert found is not None
    return int(found.group())


def stopped_by_escape(surgeon: Surgeon, words: str) -> Any:
    """Scan, press Esc once A-scans come; return how the robot stands then."""
    surgeon.button(words).click()
    share = surgeon.frame.get_by_text(re.compile(r"^Scanning: [1-9]\d* %"))
    share.wait_for()  # A-scans have begun to come
    asked_s = time.monotonic()
    assert surgeon.ask("/sessions/current/robot/state")["moving"]
    # soon, whatever the page has to draw; on a slow machine as late as a few answers come
    soon_s = max(5.0, 10.0 * (time.monotonic() - asked_s))
    surgeon.page.keyboard.press("Escape")
    pressed_s = time.monotonic()
    wait_for(lambda: not surgeon.ask("/sessions/current/robot/state")["moving"], "rest", soon_s)
    stopped = surgeon.ask("/sessions/current/robot/state")
    assert time.monotonic() - pressed_s < soon_s
    surgeon.wait_idle()
    recorded = surgeon.ask("/sessions/current")["captures"][-1]
    assert (recorded["kind"], recorded["partial"]) == ("ScanCapture", True)
    return stopped


def test_escape_stops_the_robot_while_it_scans(surgeon: Surgeon) -> None:
    """On the demo session, slowly enough to be stopped in the middle of the path."""
    surgeon.open_demo()
    surgeon.open_step("Scan")
    whole = ascans_told(surgeon, "Replay them below")
    before = surgeon.states()
    stopped = stopped_by_escape(surgeon, "Scan again")
    # a repeat: the whole scan of before stands, with its maps
    surgeon.frame.get_by_text("the previous recording and its results are unchanged").wait_for()
    assert ascans_told(surgeon, "Replay them below") == whole
    assert surgeon.states() == before

    time.sleep(2.0)  # a hand off the keys: nothing may move by itself
    later = surgeon.ask("/sessions/current/robot/state")
    assert later["joints_deg"] == stopped["joints_deg"]
    assert not later["moving"]
    assert all(job["state"] != "running" for job in surgeon.ask("/jobs"))

    back = surgeon.button("Retract probe")  # it stands on the bone
    back.click()
    back.wait_for(state="hidden")
    surgeon.wait_idle()
    wait_for(lambda: surgeon.ask("/jobs")[-1]["state"] == "done", "the probe to be back")
    assert surgeon.ask("/jobs")[-1]["activity"] == "StartRetract"
    assert back.is_hidden()

    plan = rona_core.open(demo_session()).session.results.roll.value
    other = next(
        i for i, v in enumerate(plan.search.verdicts) if v.feasible and i != plan.search.chosen
    )
    put(surgeon, "/commands/ChooseRoll", {"index": other})
    surgeon.wait_state("Scan", "stale")
    stopped_by_escape(surgeon, "Scan")
    count = ascans_told(surgeon, "Stopped early: scan again")
    assert 0 < count < 0.9 * whole
    assert surgeon.frame.get_by_text("Replay them below").count() == 0
    surgeon.wait_state("Scan", "partial")
    ascans = "/sessions/current/ascans/first"
    assert "code" not in surgeon.ask(f"{ascans}/{count - 1}")
    assert surgeon.ask(f"{ascans}/{count}")["code"] == "not_found"

    home = surgeon.button("Robot home")
    home.click()
    home.wait_for(state="hidden")
    surgeon.wait_idle()
    wait_for(lambda: surgeon.ask("/jobs")[-1]["state"] == "done", "the robot to be at home")
    assert surgeon.ask("/jobs")[-1]["activity"] == "StartHome"
    at_rest = surgeon.ask("/sessions/current/robot/state")["joints_deg"]
    assert at_rest == pytest.approx(np.rad2deg(robot_model("rx90").home_rad), abs=0.01)
    assert home.is_hidden()
    assert surgeon.button("Retract probe").is_hidden()
    assert surgeon.errors == []
