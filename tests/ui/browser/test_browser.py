"""The whole procedure in a real browser, by mouse and keyboard alone."""

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.helpers.ui.browser_driver import (
    PICTURES,
    STEPS,
    Surgeon,
    running_server,
    surgeon_at,
    wait_for,
)

pytestmark = [pytest.mark.browser, pytest.mark.slow]
PACE = None if PICTURES else 40.0  # times real time; None is what `rona serve` takes
# a name that would be markup if it were not escaped; a plain one where pictures are kept
NAME = "Bone 7" if PICTURES else "Bone <b>7</b> & co"


@pytest.fixture(scope="module")
def surgeon(
    tmp_path_factory: pytest.TempPathFactory, pictures: Path, browser: Any
) -> Iterator[Surgeon]:
    with (
        running_server(tmp_path_factory.mktemp("sessions"), PACE) as address,
        surgeon_at(browser, address, pictures) as surgeon,
    ):
        yield surgeon


def region_center(surgeon: Surgeon) -> np.ndarray:
    """Read the centre of the region from what the set-up step says."""
    words = surgeon.frame.get_by_text("Region: centre").inner_text()
    found = re.search(r"\((-?\d+), (-?\d+), (-?\d+)\)", words)
    assert found is not None
    return np.array([float(part) for part in found.groups()])


def quality(surgeon: Surgeon) -> list[str]:
    surgeon.tab("Quality")
    rows = surgeon.frame.locator(".r-table", has_text="Quantity").locator("tr")
    return [row.strip() for row in rows.all_inner_texts()]


def bed_of(surgeon: Surgeon) -> Any:
    """Read the bed of step 10 over REST; None before there is one."""
    return surgeon.ask("/sessions/current/results/implant")["results"]["bed"]["value"]


def draw_meander(surgeon: Surgeon, center: np.ndarray) -> None:
    """Draw on the skull: drag along eight lines over the region."""
    mouse = surgeon.page.mouse
    for number, y in enumerate(np.arange(-17.5, 18.0, 5.0)):
        half = np.sqrt(22.0**2 - y**2)
        ends = [
            center + np.array([x, y, 0.15 * x - 0.006 * (x * x + y * y)]) for x in (-half, half)
        ]
        if number % 2:
            ends.reverse()
        (x0, y0), (x1, y1) = surgeon.pixels([tuple(end) for end in ends])
        mouse.move(x0, y0)
        mouse.down()
        for share in np.linspace(0.05, 1.0, 20):
            mouse.move(x0 + share * (x1 - x0), y0 + share * (y1 - y0))
            time.sleep(0.03)  # a hand; the page reports a drag at most 20 times a second
        mouse.up()


def points_so_far(surgeon: Surgeon) -> int:
    words = surgeon.frame.get_by_text("points so far").inner_text()
    found = re.search(r"(\d+) points so far", words)
    return int(found.group(1)) if found else 0


def test_the_page_opens_on_a_copy_of_the_demo_session(surgeon: Surgeon) -> None:
    assert surgeon.states() == ["done"] * len(STEPS)
    assert "not saved" in surgeon.saved()
    surgeon.open_step("Maps")
    wait_for(lambda: any("Inner boundary" in row for row in quality(surgeon)), "figures")
    surgeon.tab("A-scan")
    wait_for(lambda: "/maps/inner" in surgeon.nodes(), "the maps")
    surgeon.frame.locator(".uplot canvas").filter(visible=True).wait_for()
    surgeon.picture("demo")


def test_ten_steps_by_mouse_then_saved_and_opened_again(surgeon: Surgeon) -> None:
    frame, page = surgeon.frame, surgeon.page

    # a new session under a name of its own
    surgeon.menu("sessionbutton", "New session")
    wait_for(lambda: surgeon.states()[1:3] == ["ready", "ready"], "a new session")
    surgeon.menu("sessionbutton", "Rename")
    page.locator("#namingfield").fill(NAME)
    page.keyboard.press("Enter")
    name = page.locator("#name")
    name.get_by_text(NAME, exact=True).wait_for()
    assert name.locator("b").count() == 0  # none from the name
    surgeon.open_step("Set-up")
    assert surgeon.states() == ["done", "ready", "ready", *["blocked"] * 7]
    center = region_center(surgeon)
    surgeon.picture("setup")

    # a step that is blocked says why and cannot be started
    surgeon.open_step("Scan")
    assert frame.get_by_text("Blocked: first plan the motion").is_visible()
    assert surgeon.button("Scan").is_disabled()

    for step, primary in (("Tool", "Move and register"), ("Pointer", "Pivot and calibrate")):
        surgeon.open_step(step)
        surgeon.button(primary).click()
        surgeon.wait_state(step, "done")
        surgeon.picture(step.lower())
    surgeon.button("Next: 4 Surface").click()
    surgeon.button("Sweep the region").click()
    surgeon.wait_state("Surface", "done")
    surgeon.picture("surface")

    # the path is drawn on the skull in the 3D scene
    surgeon.open_step("Path")
    surgeon.button("Draw on the skull").click()
    frame.get_by_text("points so far").wait_for()
    draw_meander(surgeon, center)
    wait_for(lambda: points_so_far(surgeon) >= 60, "60 points on the skull")
    assert {"/drawing/line", "/drawing/points"} <= set(surgeon.nodes())
    surgeon.picture("path")
    surgeon.button("Finish stroke").click()
    surgeon.wait_state("Path", "done")
    wait_for(lambda: "/path/raw" in surgeon.nodes(), "the path in the scene")
    assert "/drawing/line" not in surgeon.nodes()

    surgeon.open_step("Smoothing")
    surgeon.button("Smooth the path").click()
    surgeon.wait_state("Smoothing", "done")
    surgeon.picture("smoothing")
    surgeon.open_step("Roll")
    surgeon.button("Plan motion").click()
    surgeon.wait_state("Roll", "done")
    surgeon.tab("Rolls")
    assert frame.get_by_text("s, verified.").is_visible()
    surgeon.picture("roll")
    surgeon.open_step("Scan")
    surgeon.button("Scan").click()
    surgeon.wait_state("Scan", "done")
    surgeon.tab("A-scan")
    surgeon.picture("scan")
    surgeon.open_step("Maps")
    surgeon.button("Map the boundaries").click()
    surgeon.wait_state("Maps", "done")
    surgeon.wait_idle()
    wait_for(lambda: any("Inner boundary" in row for row in quality(surgeon)), "figures")
    assert {"/maps/outer", "/maps/inner", "/maps/fused"} <= set(surgeon.nodes())
    surgeon.picture("maps")
    surgeon.open_step("Implant bed")
    surgeon.button("Search the bed").click()
    bed = wait_for(lambda: bed_of(surgeon), "a bed, or why there is none")
    surgeon.wait_idle()
    mapped = bed["placed"] is not None and bed["placed"]["residual_mm"] is not None
    wait_for(lambda: ("/implant/body" in surgeon.nodes()) == mapped, "the implant in the scene")
    if mapped:  # figures come later than what they judge
        true_bone = "Bone below the bed, true"
        wait_for(lambda: any(true_bone in row for row in quality(surgeon)), "figures of the bed")
    surgeon.picture("implant")

    # saved, gone, and opened again: the same states, figures and scene
    page.keyboard.press("Control+s")
    wait_for(lambda: surgeon.saved() == "saved", "the file")
    states, figures, nodes = surgeon.states(), quality(surgeon), surgeon.nodes()
    assert states[:-1] == ["done"] * (len(STEPS) - 1)  # the bone may be too thin for a bed
    surgeon.menu("sessionbutton", "New session")
    wait_for(lambda: surgeon.states()[1] == "ready", "a new session")
    assert "/maps/inner" not in surgeon.nodes()
    page.locator("#logo").click()
    card = page.locator("#homefiles .card").filter(has_text="Bone")
    card.locator("img").wait_for()  # of the maps, taken when it was saved
    surgeon.picture("home")
    card.click()
    surgeon.wait_state("Maps", "done")
    surgeon.come()  # the page anew: nothing that is shown may live in the browser
    surgeon.open_step("Implant bed")  # the figures of the open step stand first
    wait_for(lambda: quality(surgeon) == figures, "the figures to come back")
    assert surgeon.states() == states
    assert surgeon.nodes() == nodes
    assert page.locator("#name").inner_text() == NAME
    assert surgeon.errors == []


def test_undo_by_key_takes_back_one_change_and_an_earlier_change_makes_later_steps_stale(
    surgeon: Surgeon,
) -> None:
    surgeon.open_step("Set-up")
    before = surgeon.states()
    seed = surgeon.field("Seed")
    seed.fill("5")
    seed.press("Enter")
    surgeon.wait_state("Tool", "stale")
    assert surgeon.states()[1:9] == ["stale"] * 8  # there may be no bed
    surgeon.page.mouse.click(800, 120)  # beside every field
    surgeon.page.keyboard.press("Control+z")
    wait_for(lambda: surgeon.states() == before, "the steps to be done again")


def test_a_value_out_of_range_is_told_and_the_field_shows_the_truth(surgeon: Surgeon) -> None:
    surgeon.open_step("Set-up")
    radius = surgeon.field("Region radius")
    held = radius.input_value()
    radius.fill("453")
    assert radius.input_value() == "453"  # nothing happens before it is finished
    radius.press("Enter")
    surgeon.frame.get_by_text("Region radius (mm) must be 5 to 45, not 453").first.wait_for()
    wait_for(lambda: radius.input_value() == held, "the field to show the truth")
