"""The keyboard in a real browser: fields, Esc, and what the log keeps of refusals."""

import contextlib
import os
import re
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.helpers.ui.browser_driver import (
    CHROMIUM,
    DRAWN_BY,
    FLAGS,
    SMALL,
    Surgeon,
    running_server,
    wait_for,
)

pytestmark = [pytest.mark.browser, pytest.mark.slow]
PAUSE_S = 0.6  # longer than a dragged field takes to settle
POST = """async ([path, body]) => (await fetch('/api/v1/sessions/current' + path, {method: 'POST',
  headers: {'Content-Type': 'application/json'}, body: JSON.stringify(body)})).status"""


@pytest.fixture(scope="module")
def surgeon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Surgeon]:
    if not CHROMIUM.is_file():
        reason = (
            f"no browser at {CHROMIUM}: see tests/tools/install_browser.sh, or set RONA_CHROMIUM"
        )
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    playwright = pytest.importorskip("playwright.sync_api")
    flags = (*FLAGS, *DRAWN_BY[os.environ.get("RONA_E2E_GL", "mesa")])
    with (
        running_server(tmp_path_factory.mktemp("sessions"), pace=2.0) as address,
        playwright.sync_playwright() as driver,
    ):
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(flags))
        page = browser.new_page(viewport=SMALL)
        page.set_default_timeout(60_000)
        yield Surgeon(page, address, tmp_path_factory.mktemp("pictures"))
        browser.close()


def setup(surgeon: Surgeon) -> dict[str, Any]:
    return surgeon.ask("/sessions/current")["setup"]


def radius(surgeon: Surgeon) -> float:
    return setup(surgeon)["region"]["radius_mm"]


def revision(surgeon: Surgeon) -> int:
    return surgeon.ask("/sessions/current")["revision"]


def put(surgeon: Surgeon, path: str, body: Any) -> None:
    assert surgeon.page.evaluate(POST, [path, body]) < 300


def retype(surgeon: Surgeon, field: Any, text: str) -> None:
    """Type over what a field holds, as slowly as somebody who thinks."""
    field.click()
    surgeon.page.keyboard.press("Control+a")
    first, rest = text[:1], text[1:]
    surgeon.page.keyboard.type(first)
    time.sleep(PAUSE_S)
    surgeon.page.keyboard.type(rest)


def shows(field: Any, text: str) -> Any:
    return wait_for(lambda: field.input_value() == text, 10, f"the field to show {text}")


def log(surgeon: Surgeon) -> list[str]:
    surgeon.tab("Log")
    lines = surgeon.frame.locator(".r-log").filter(visible=True).locator("> div")
    return [" ".join(line.split()) for line in lines.all_inner_texts()]


def close_notices(surgeon: Surgeon) -> None:
    """Close what is announced; some of it goes by itself meanwhile."""
    buttons = surgeon.frame.locator(".mantine-Notification-root button")

    def closed() -> bool:
        if buttons.count():
            with contextlib.suppress(Exception):  # it has just gone
                buttons.first.click(timeout=1000)
        return buttons.count() == 0

    wait_for(closed, 60, "the notices to go")


@pytest.mark.parametrize("end", ["Enter", "Tab"])
def test_a_field_is_sent_when_it_is_finished_and_one_edit_is_one_undo(
    surgeon: Surgeon, end: str
) -> None:
    surgeon.open_step("Set-up")
    field, held, before = surgeon.field("Region radius"), radius(surgeon), revision(surgeon)
    retype(surgeon, field, "30")
    time.sleep(PAUSE_S)
    assert (field.input_value(), revision(surgeon)) == ("30", before)
    surgeon.page.keyboard.press(end)
    wait_for(lambda: radius(surgeon) == 30.0, 10, "the radius")
    shows(field, "30")
    time.sleep(PAUSE_S)
    assert revision(surgeon) == before + 1
    put(surgeon, "/undo", None)
    shows(field, f"{held:g}")
    assert radius(surgeon) == held


@pytest.mark.parametrize(
    ("label", "text", "reason"),
    [
        ("Region radius", "453", "Region radius (mm) must be 5 to 45, not 453"),
        ("Region radius", "1e9", "Region radius (mm) must be 5 to 45, not 1000000000"),
        ("Region radius", "abc", "Region radius (mm): expected a number such as 2.5, not 'abc'"),
        (
            "Region radius",
            "1,000",
            "Region radius (mm): expected a number such as 2.5, not '1,000'",
        ),
        ("Seed", "2.5", "Seed: expected a whole number, not 2.5"),
        ("Seed", "-1", "Seed must be 0 to 2147483647, not -1"),
    ],
)
@pytest.mark.parametrize("end", ["Enter", "Tab"])
def test_what_cannot_be_taken_is_told_kept_in_the_log_and_the_field_shows_the_truth(
    surgeon: Surgeon, label: str, text: str, reason: str, end: str
) -> None:
    surgeon.open_step("Set-up")
    close_notices(surgeon)
    field, before = surgeon.field(label), revision(surgeon)
    held = field.input_value()
    retype(surgeon, field, text)
    surgeon.page.keyboard.press(end)
    notice = surgeon.frame.locator(".mantine-Notification-root", has_text=reason)
    notice.first.wait_for()
    shows(field, held)
    time.sleep(PAUSE_S)
    assert (field.input_value(), revision(surgeon)) == (held, before)
    newest = log(surgeon)[0]
    assert re.match(r"\d\d:\d\d:\d\d UTC · 1 Set-up ✖ Invalid value", newest)
    assert newest.endswith(reason)


def test_a_number_is_taken_as_it_was_meant(surgeon: Surgeon) -> None:
    surgeon.open_step("Set-up")
    field = surgeon.field("Region radius")
    for text, value in (("1e1", 10.0), ("12,5", 12.5), ("20.123", 20.123), ("25", 25.0)):
        retype(surgeon, field, text)
        surgeon.page.keyboard.press("Enter")
        wait_for(lambda value=value: radius(surgeon) == value, 10, text)
        shows(field, f"{value:g}")


def test_what_is_being_typed_stays_whatever_the_session_writes_meanwhile(surgeon: Surgeon) -> None:
    surgeon.open_step("Set-up")
    field, keys = surgeon.field("Region radius"), surgeon.page.keyboard
    retype(surgeon, field, "3")
    put(surgeon, "/commands/SetRegion", {"radius_mm": 40.0})
    put(surgeon, "/commands/SetSeed", {"seed": 4})
    shows(surgeon.field("Seed"), "4")  # the page has been drawn anew
    keys.type("3")
    assert field.input_value() == "33"
    keys.press("Escape")  # taken back: now it shows what was written meanwhile
    shows(field, "40")
    assert radius(surgeon) == 40.0
    for _ in range(2):
        put(surgeon, "/undo", None)
    shows(field, "25")


def test_an_arrow_first_takes_what_was_typed_and_then_goes_on_from_there(surgeon: Surgeon) -> None:
    surgeon.open_step("Set-up")
    field, keys = surgeon.field("Region radius"), surgeon.page.keyboard
    for step in (lambda: keys.press("ArrowUp"), lambda: beside(field).click()):
        retype(surgeon, field, "30")
        step()
        wait_for(lambda: radius(surgeon) == 30.0, 10, "what was typed")
        shows(field, "30")
        time.sleep(PAUSE_S)  # what comes back for the typed value is drawn
        step()
        wait_for(lambda: radius(surgeon) == 31.0, 30, "one more")
        shows(field, "31")
    retype(surgeon, field, "25")
    keys.press("Enter")
    wait_for(lambda: radius(surgeon) == 25.0, 10, "the radius as it was")


def beside(field: Any) -> Any:
    """Return the arrow up beside a number."""
    root = "xpath=ancestor::div[contains(@class, 'mantine-NumberInput-root')][1]"
    return field.locator(root).locator("button").first


def test_texts_components_and_sliders_wait_for_their_end_too(surgeon: Surgeon) -> None:
    frame, keys = surgeon.frame, surgeon.page.keyboard
    surgeon.open_step("Set-up")
    frame.get_by_text("Robot", exact=True).filter(visible=True).first.click()
    shift = surgeon.field("Base shift")
    parts = shift.locator("xpath=ancestor::div[contains(@class,'mantine-Flex-root')][1]//input")
    before = revision(surgeon)
    retype(surgeon, parts.nth(1), "-12.5")
    assert revision(surgeon) == before
    keys.press("Tab")
    held = [0.0, -12.5, 0.0]
    wait_for(lambda: setup(surgeon)["devices"]["robot"]["base_shift_mm"] == held, 10, "the shift")
    shows(parts.nth(1), "-12.5")
    assert revision(surgeon) == before + 1
    put(surgeon, "/undo", None)
    frame.get_by_text("Robot", exact=True).filter(visible=True).first.click()

    surgeon.open_step("Smoothing")
    slider = frame.locator(".mantine-NumberInput-input").filter(visible=True).first
    held_text = slider.input_value()
    retype(surgeon, slider, "50")
    assert slider.input_value() == "50"
    keys.press("Enter")
    frame.get_by_text("Tolerance (mm) must be 0.1 to 5, not 50").filter(
        visible=True
    ).first.wait_for()
    shows(slider, held_text)

    frame.get_by_text("Session", exact=True).click()
    name = surgeon.field("Name")
    retype(surgeon, name, "of a patient")
    surgeon.button("Rename").click()  # the click leaves the field
    wait_for(lambda: surgeon.ask("/sessions/current")["name"] == "of a patient", 10, "the name")
    frame.get_by_text("Session", exact=True).click()
    assert surgeon.errors == []


# -- Esc -------------------------------------------------------------------------------------------


def drawing(surgeon: Surgeon) -> bool:
    return surgeon.button("Finish stroke").is_visible()


def begin_drawing(surgeon: Surgeon) -> None:
    surgeon.open_step("Path")
    surgeon.button("Draw on the skull").click()
    surgeon.button("Finish stroke").wait_for()


def palette(surgeon: Surgeon) -> Any:
    return surgeon.frame.locator("input.mantine-Spotlight-search")


def open_palette(surgeon: Surgeon) -> None:
    # the keys go to the viewer, and not to a button of the page around it that was clicked last
    surgeon.frame.evaluate("() => { document.activeElement?.blur(); window.focus(); }")
    wait_for(lambda: surgeon.frame.evaluate("document.hasFocus()"), 10, "the viewer's focus")
    surgeon.page.keyboard.press("Control+k")
    palette(surgeon).wait_for()
    inside = "document.activeElement?.matches('input.mantine-Spotlight-search')"
    wait_for(lambda: surgeon.frame.evaluate(inside), 10, "the palette to listen")


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
    wait_for(lambda: not drawing(surgeon), 10, "drawing to end")
    assert surgeon.button("Draw on the skull").is_visible()

    begin_drawing(surgeon)
    page.locator("#help").focus()  # outside of the viewer
    keys.press("Escape")
    wait_for(lambda: not drawing(surgeon), 10, "drawing to end")
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
    wait_for(lambda: announced(surgeon) == "Robot stopped", 10, "the word of the stop")
    for job in surgeon.ask("/jobs"):
        page.evaluate("(id) => fetch('/api/v1/jobs/' + id, {method: 'DELETE'})", job["id"])
    wait_for(lambda: idle(surgeon), 60, "the search to end")
    assert surgeon.errors == []


@pytest.mark.parametrize(
    "opened", [open_palette, open_menu, type_something, open_help, lambda surgeon: None]
)
def test_escape_stops_the_robot_that_moves_whatever_is_open(
    surgeon: Surgeon, opened: Callable[[Surgeon], None]
) -> None:
    page = surgeon.page
    wait_for(lambda: announced(surgeon) == "", 20, "what was announced before to go")
    opens = "async () => (await fetch('/api/v1/sessions/demo', {method: 'POST'})).status"
    assert page.evaluate(opens) == 201  # whole captures again
    moving = lambda: surgeon.ask("/sessions/current/robot/state")["moving"]  # noqa: E731
    opened(surgeon)  # first: while the robot moves, the fields rest
    put(surgeon, "/jobs/StartToolCapture", {})
    wait_for(moving, 120, "the robot to move")
    assert announced(surgeon) == ""
    page.keyboard.press("Escape")
    wait_for(lambda: not moving(), 5, "the robot to rest")
    wait_for(lambda: announced(surgeon) == "Robot stopped", 5, "the word of the stop")
    wait_for(lambda: idle(surgeon), 60, "the capture to end")
    assert not moving()
    assert surgeon.ask("/jobs")[-1]["state"] == "cancelled"
    assert surgeon.errors == []
