"""Fields in a real browser: when they are sent, and what the log keeps of refusals."""

import contextlib
import re
import time
from typing import Any

import pytest

from tests.helpers.ui import hand
from tests.helpers.ui.browser_driver import PAUSE_S, Surgeon, put, retype, shows, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def setup(surgeon: Surgeon) -> dict[str, Any]:
    return surgeon.ask("/sessions/current")["setup"]


def radius(surgeon: Surgeon) -> float:
    return setup(surgeon)["region"]["radius_mm"]


def revision(surgeon: Surgeon) -> int:
    return surgeon.ask("/sessions/current")["revision"]


def newest_of_log(surgeon: Surgeon) -> str:
    surgeon.tab("Log")
    lines = surgeon.frame.locator(".r-log").filter(visible=True).locator("> div")
    lines.first.wait_for()  # what a tab shows is built when the tab is opened
    return " ".join(lines.first.inner_text().split())


def close_notices(surgeon: Surgeon) -> None:
    """Close what is announced; some of it goes by itself meanwhile."""
    buttons = surgeon.frame.locator(".mantine-Notification-root button")

    def closed() -> bool:
        if buttons.count():
            with contextlib.suppress(Exception):  # it has just gone
                buttons.first.click(timeout=1000)
        return buttons.count() == 0

    wait_for(closed, "the notices to go")


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
    wait_for(lambda: radius(surgeon) == 30.0, "the radius")
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
    surgeon.frame.locator(".r-wrong", has_text=reason).filter(visible=True).wait_for()
    shows(field, held)
    time.sleep(PAUSE_S)
    assert (field.input_value(), revision(surgeon)) == (held, before)
    newest = newest_of_log(surgeon)
    assert re.match(r"\d\d:\d\d:\d\d UTC · 1 Set-up ✖ Invalid value", newest)
    assert newest.endswith(reason)


def test_a_number_is_taken_as_it_was_meant(surgeon: Surgeon) -> None:
    surgeon.open_step("Set-up")
    field = surgeon.field("Region radius")
    for text, value in (("1e1", 10.0), ("12,5", 12.5), ("20.123", 20.123), ("25", 25.0)):
        retype(surgeon, field, text)
        surgeon.page.keyboard.press("Enter")
        wait_for(lambda value=value: radius(surgeon) == value, text)
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
        wait_for(lambda: radius(surgeon) == 30.0, "what was typed")
        shows(field, "30")
        time.sleep(PAUSE_S)  # what comes back for the typed value is drawn
        step()
        wait_for(lambda: radius(surgeon) == 31.0, "one more")
        shows(field, "31")
    retype(surgeon, field, "25")
    keys.press("Enter")
    wait_for(lambda: radius(surgeon) == 25.0, "the radius as it was")


def beside(field: Any) -> Any:
    """Return the arrow up beside a number."""
    root = "xpath=ancestor::div[contains(@class, 'mantine-NumberInput-root')][1]"
    return field.locator(root).locator("button").first


def test_texts_components_and_sliders_wait_for_their_end_too(surgeon: Surgeon) -> None:
    frame, keys = surgeon.frame, surgeon.page.keyboard
    surgeon.open_step("Set-up")
    hand.unfold(surgeon, "Robot")
    shift = surgeon.field("Base shift")
    parts = shift.locator("xpath=ancestor::div[contains(@class,'mantine-Flex-root')][1]//input")
    before = revision(surgeon)
    retype(surgeon, parts.nth(1), "-12.5")
    assert revision(surgeon) == before
    keys.press("Tab")
    held = [0.0, -12.5, 0.0]
    wait_for(lambda: setup(surgeon)["devices"]["robot"]["base_shift_mm"] == held, "the shift")
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

    assert surgeon.errors == []
