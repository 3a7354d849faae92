"""The page says the same everywhere, of steps that miss a limit, of stale ones, and of refusals."""

import pytest

from tests.helpers.ui.browser_driver import STEPS, Surgeon, put, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.slow]
MOVED_MM = 5.0


def row_of(surgeon: Surgeon, step: str) -> str:
    """Return the words of a step in the list."""
    number = STEPS.index(step) + 1
    return surgeon.frame.locator(".r-step").nth(number - 1).inner_text()


def test_a_moved_path_point_fails_in_list_panel_and_table_alike(surgeon: Surgeon) -> None:
    surgeon.open_demo()
    surgeon.open_step("Smoothing")
    corners = surgeon.ask("/sessions/current/results/smoothing")["results"]["smoothing"]["value"]
    place = corners["corners_base"][len(corners["corners_base"]) // 2]
    assert "pass" not in row_of(surgeon, "Smoothing")
    moved = [place[0] + MOVED_MM, *place[1:]]
    index = len(corners["corners_base"]) // 2
    put(surgeon, "/commands/MovePathPoint", {"index": index, "point_base_mm": moved})
    fails = surgeon.frame.locator(".r-note", has_text="fail")
    fails.first.wait_for()
    assert "eviation" in fails.first.inner_text()
    wait_for(lambda: "fail" in row_of(surgeon, "Smoothing"), "the list to say so")
    surgeon.tab("Quality")
    surgeon.frame.get_by_text("✖ fail: ").first.wait_for()  # how many, above the table
    row = surgeon.frame.locator(".r-table tr", has_text="Max. path deviation").first
    wait_for(lambda: "✖ fail" in row.inner_text(), "the table to say so")
    assert surgeon.button("Continue").is_hidden()  # it is looked at first
    assert surgeon.errors == []


def test_behind_another_robot_nothing_can_be_started_and_no_old_angles_are_drawn(
    surgeon: Surgeon,
) -> None:
    surgeon.open_demo()
    put(surgeon, "/commands/SetRobot", {"model": "ur10"})
    surgeon.wait_state("Roll", "stale")
    surgeon.open_step("Scan")
    surgeon.frame.get_by_text("Stale: ").first.wait_for()
    assert surgeon.button("Scan").is_disabled()
    surgeon.page.keyboard.press("Control+Enter")
    assert not [job for job in surgeon.ask("/jobs") if not job["finished"]]
    assert not {name for name in surgeon.nodes() if name.startswith("/rolls")}
    assert surgeon.errors == []


def test_a_pivot_that_says_too_little_is_told_until_something_was_done(surgeon: Surgeon) -> None:
    surgeon.open_demo()
    surgeon.open_step("Pointer")
    states = surgeon.states()
    surgeon.button("Pivot by hand").click()
    surgeon.button("Finish and calibrate").click()
    surgeon.button("Pivot by hand").wait_for()
    surgeon.wait_idle()
    told = surgeon.frame.locator(".r-note", has_text="✖").first
    told.wait_for()
    words = told.inner_text()
    assert len(words) > 40  # what came, and what to do
    surgeon.page.wait_for_timeout(14_000)  # a notice is gone by then
    assert told.inner_text() == words
    surgeon.tab("Log")
    surgeon.frame.get_by_text(words.split(". ")[0].removeprefix("✖ ")).last.wait_for()
    surgeon.page.locator("#undo").click()  # the pivot before, and all that was built on it
    wait_for(lambda: surgeon.states() == states, "what was there before")
    assert surgeon.errors == []
