"""Nothing is lost and nothing lies, in a real browser: figures, refusals, hints, tabs, progress."""

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.helpers.ui.browser_driver import (
    Surgeon,
    put,
    retype,
    running_server,
    shows,
    surgeon_at,
    wait_for,
)

pytestmark = [pytest.mark.browser, pytest.mark.slow]
RUNNING = re.compile(r"\d+ %, (about \d+ (s|min)|a few seconds) left")


@pytest.fixture(scope="module")
def surgeon(
    tmp_path_factory: pytest.TempPathFactory, pictures: Path, browser: Any
) -> Iterator[Surgeon]:
    with (
        running_server(tmp_path_factory.mktemp("truth"), pace=4.0) as address,
        surgeon_at(browser, address, pictures) as surgeon,
    ):
        yield surgeon


def chosen_tabs(surgeon: Surgeon) -> list[str]:
    tabs = surgeon.frame.locator("[data-dock-strip] [aria-selected=true]")
    return [tab.strip() for tab in tabs.all_inner_texts()]


def first_section(surgeon: Surgeon) -> str:
    rows = surgeon.frame.locator(".r-table", has_text="Quantity").locator("tr.sec")
    return str(rows.first.inner_text()).lower() if rows.count() else ""


def test_the_tabs_follow_the_step_and_then_are_the_surgeon_s(surgeon: Surgeon) -> None:
    for step, tabs in (
        ("Roll", {"Rolls", "Joints"}),
        ("Scan", {"Quality", "A-scan"}),
        ("Pointer", {"Quality", "Poses"}),
    ):
        surgeon.open_step(step)
        wait_for(lambda tabs=tabs: tabs <= set(chosen_tabs(surgeon)), f"the tabs of {step}")
    shown = surgeon.frame.get_by_text("Shaft directions by tilt")
    shown.filter(visible=True).first.wait_for()
    surgeon.picture("calibration")
    surgeon.tab("Checks")
    put(surgeon, "/commands/RenameSession", {"name": "another"})
    surgeon.page.locator("#name").get_by_text("another").wait_for()
    assert "Checks" in chosen_tabs(surgeon)  # the step is the same
    focused = surgeon.frame.evaluate("document.activeElement?.dataset?.dockTab ?? null")
    surgeon.open_step("Roll")
    wait_for(lambda: "Joints" in chosen_tabs(surgeon), "the tabs of the next step")
    assert surgeon.frame.evaluate("document.activeElement?.dataset?.dockTab ?? null") is None, (
        focused
    )


def test_the_figures_of_the_active_step_come_first(surgeon: Surgeon) -> None:
    for step, title in (("Maps", "step 9: maps"), ("Tool", "step 2: tool")):
        surgeon.open_step(step)
        wait_for(lambda title=title: first_section(surgeon) == title, title)
    surgeon.open_step("Maps")
    surgeon.picture("quality")


def test_buttons_labels_and_rows_of_the_list_say_on_hover_what_they_are(surgeon: Surgeon) -> None:
    frame = surgeon.frame
    surgeon.open_step("Tool")
    label = frame.locator("label", has_text="Pivot cone").filter(visible=True).first
    again = surgeon.button("Move and register the tool")
    for control, words in ((label, "5 to 45 deg."), (again, "Starts the active step")):
        control.hover()
        wait_for(lambda c=control, w=words: w in (c.get_attribute("title") or ""), words)
    row = surgeon.button("Step 6: Smoothing")
    row.hover()
    wait_for(lambda: "34 points" in (row.get_attribute("title") or ""), "the reason in full")


def test_a_refused_text_is_explained_below_its_field_and_stays(surgeon: Surgeon) -> None:
    frame, reason = surgeon.frame, "Region radius (mm) must be 5 to 45, not 453"
    surgeon.open_step("Set-up")
    field = surgeon.field("Region radius")
    held = field.input_value()
    retype(surgeon, field, "453")
    surgeon.page.keyboard.press("Enter")
    below = frame.locator(".r-wrong").filter(visible=True)
    below.wait_for()
    assert below.inner_text() == reason
    surgeon.picture("refused")
    box, words = field.bounding_box(), below.bounding_box()
    assert 0 <= words["y"] - (box["y"] + box["height"]) < 20  # right below it
    assert frame.locator(".mantine-Notification-root", has_text=reason).count() == 0
    assert frame.locator(".r-note", has_text=reason).count() == 0  # it is told once
    retype(surgeon, field, "30")
    surgeon.page.keyboard.press("Enter")
    below.wait_for(state="hidden")
    surgeon.tab("Log")
    frame.locator(".r-log", has_text=reason).filter(visible=True).first.wait_for()
    put(surgeon, "/undo", None)
    shows(field, held)


def region(surgeon: Surgeon) -> Any:
    return surgeon.ask("/sessions/current")["setup"]["region"]


def pick(surgeon: Surgeon, offset_mm: tuple[float, float, float]) -> np.ndarray:
    """Pick the region by a click beside where it is; return its new centre on the skull."""
    words = surgeon.frame.get_by_text("Region: centre").inner_text()
    x, y, z = (float(n) for n in re.findall(r"-?\d+", words)[:3])
    surgeon.button("Pick region").click()
    surgeon.frame.get_by_text("Click the skull where the centre").wait_for()
    time.sleep(1.0)  # the camera comes nearer
    held = region(surgeon)["center_mesh_mm"]
    place = (x + offset_mm[0], y + offset_mm[1], z + offset_mm[2])
    surgeon.page.mouse.click(*surgeon.pixels([place])[0])
    wait_for(lambda: region(surgeon)["center_mesh_mm"] != held, "the new region")
    surgeon.button("Pick region").wait_for()
    return np.array(region(surgeon)["center_mesh_mm"])


def test_the_region_is_chosen_by_a_click_on_the_skull_and_keeps_its_place(
    surgeon: Surgeon,
) -> None:
    surgeon.open_demo()
    surgeon.open_step("Set-up")
    assert region(surgeon)["center_mesh_mm"] is None
    first = pick(surgeon, (0.0, 0.0, 0.0))
    assert surgeon.states()[3:8] == ["stale"] * 5
    surgeon.frame.get_by_text("Region: centre").wait_for()
    second = pick(surgeon, (0.0, 15.0, -1.0))
    assert 11.0 < np.linalg.norm(second - first) < 19.0
    surgeon.picture("region")
    retype(surgeon, surgeon.field("Region radius"), "20")
    surgeon.page.keyboard.press("Enter")
    wait_for(lambda: region(surgeon)["radius_mm"] == 20.0, "another radius")
    np.testing.assert_array_equal(region(surgeon)["center_mesh_mm"], second)
    surgeon.button("Pick region").click()
    surgeon.button("Cancel picking").click()
    surgeon.button("Reset region").click()
    wait_for(lambda: region(surgeon)["center_mesh_mm"] is None, "the program's own place")
    assert region(surgeon)["radius_mm"] == 20.0
    assert surgeon.errors == []


def test_a_sweep_that_is_cancelled_keeps_the_one_before(surgeon: Surgeon) -> None:
    surgeon.open_demo()
    surgeon.open_step("Surface")
    before = surgeon.states()
    points = surgeon.ask("/sessions/current/results/surface?max_points=300")
    surgeon.button("Sweep the region").click()
    surgeon.frame.get_by_text(RUNNING).first.wait_for()
    surgeon.picture("time_left")
    surgeon.button("Cancel").click()
    surgeon.wait_idle()
    surgeon.frame.get_by_text("the previous recording and its results are unchanged").wait_for()
    assert surgeon.states() == before
    assert surgeon.ask("/sessions/current/results/surface?max_points=300") == points
    assert surgeon.errors == []


def test_a_new_surface_is_judged_only_by_its_own_figures(surgeon: Surgeon) -> None:
    surgeon.open_step("Tool")
    surgeon.button("Move and register the tool").click()
    wait_for(lambda: surgeon.states()[3] == "stale", "the new calibration")
    surgeon.wait_idle()
    left_out = surgeon.frame.get_by_text(re.compile("stale, left out: [1-9]"))
    left_out.filter(visible=True).first.wait_for()
    wait_for(lambda: not surgeon.frame.get_by_text("Computing: ").count(), "the new figures")
    assert first_section(surgeon) == "step 2: tool"
    assert surgeon.errors == []
