"""The whole procedure in a real browser: by hand with the mouse, by keys, by single clicks."""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rona_ui.scene.pointer import HANDLES_MM
from tests.helpers.ui import hand, keyboard
from tests.helpers.ui.browser_driver import (
    PICTURES,
    REPOSITORY,
    STEPS,
    Surgeon,
    running_server,
    surgeon_at,
    wait_for,
)
from tests.helpers.ui.clicks import (
    MOST,
    PRIMARY,
    TO_MAPS,
    TO_PLAN,
    count,
    counted,
    new_session,
    run_next,
)

pytestmark = [pytest.mark.browser, pytest.mark.slow]
PACE = None if PICTURES else 40.0  # times real time; None is what `rona serve` takes
SHARED = Path(os.environ.get("RONA_SHARED", REPOSITORY.parent / "shared"))
LIMITS = {"outer_rms_mm": 0.35, "inner_rms_mm": 0.85, "thickness_rms_mm": 0.5}
MAPS = {
    "Outer boundary": "/maps/outer",
    "Outer, fused with pointer": "/maps/fused",
    "Inner boundary": "/maps/inner",
}
LOOK = REPOSITORY / "static" / "page" / "look.js"
SCENE_EDGES = """() => {
  const scene = document.querySelector("canvas[data-engine]").getBoundingClientRect();
  return [scene.left, innerWidth - scene.right];
}"""
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


def quality(surgeon: Surgeon) -> list[str]:
    surgeon.tab("Quality")
    rows = surgeon.frame.locator(".r-table", has_text="Quantity").locator("tr")
    return [row.strip() for row in rows.all_inner_texts()]


def bed_of(surgeon: Surgeon) -> Any:
    """Read the bed of step 10 over REST; None before there is one."""
    return surgeon.ask("/sessions/current/results/implant")["results"]["bed"]["value"]


def maps_seen(surgeon: Surgeon) -> set[str]:
    """Return which maps are to be seen."""
    return set(MAPS.values()) & set(surgeon.nodes())


def within_limits(surgeon: Surgeon) -> None:
    """Hold the maps of the open session against the limits of `make results`."""
    rows = {row["key"]: row for row in surgeon.ask("/sessions/current/quality")}
    values = {key: rows[key]["value"] for key in LIMITS}
    assert all(values[key] <= limit for key, limit in LIMITS.items()), values
    assert rows["coverage_fraction"]["value"] >= 0.9


@pytest.mark.ci
def test_the_page_opens_on_a_copy_of_the_demo_session(surgeon: Surgeon) -> None:
    assert surgeon.states() == ["done"] * len(STEPS)
    assert "not saved" in surgeon.saved()
    surgeon.open_step("Maps")
    wait_for(lambda: any("Inner boundary" in row for row in quality(surgeon)), "figures")
    surgeon.tab("A-scan")
    wait_for(lambda: "/maps/inner" in surgeon.nodes(), "the maps")
    surgeon.frame.locator(".uplot canvas").filter(visible=True).wait_for()
    surgeon.picture("demo")


def test_the_scene_lies_where_the_cover_has_held_it(surgeon: Surgeon) -> None:
    held = re.search(r"LEFT_PX = (\d+), RIGHT_PX = (\d+)", LOOK.read_text("utf-8"))
    assert held is not None
    left, right = surgeon.frame.evaluate(SCENE_EDGES)
    assert (left, right) == (int(held[1]), int(held[2]))


def test_ten_steps_by_hand_with_the_mouse_alone_then_saved_and_opened_again(
    surgeon: Surgeon,
) -> None:
    frame, page = surgeon.frame, surgeon.page

    # a new session under a name of its own; from then on no key is touched
    new_session(surgeon)
    surgeon.menu("sessionbutton", "Rename")
    page.locator("#namingfield").fill(NAME)
    page.keyboard.press("Enter")
    name = page.locator("#name")
    name.get_by_text(NAME, exact=True).wait_for()
    assert name.locator("b").count() == 0  # none from the name
    count(surgeon, "keydown")

    # the region is chosen by a click on the skull
    surgeon.open_step("Set-up")
    assert surgeon.states() == ["done", "ready", "ready", *["blocked"] * 7]
    hand.pick_region(surgeon, (2.0, -2.0, 0.0))
    center = hand.region_center(surgeon)
    surgeon.picture("setup")

    # a step that is blocked says why and cannot be started
    surgeon.open_step("Scan")
    assert frame.get_by_text("Blocked: first plan the motion").is_visible()
    assert surgeon.button("Scan").is_disabled()

    surgeon.open_step("Tool")
    surgeon.button("Move and register").click()
    surgeon.wait_state("Tool", "done")
    surgeon.picture("tool")
    surgeon.open_step("Pointer")
    for _ in range(3):  # again, if a handle slipped out of the hand
        hand.pivot(surgeon, HANDLES_MM / 1000.0)
        surgeon.picture("pointer")
        if surgeon.button("Finish and calibrate").is_visible():  # or its time was over before
            surgeon.button("Finish and calibrate").click()
        surgeon.button("Pivot by hand").wait_for()
        surgeon.wait_idle()
        if surgeon.states()[2] == "done":
            break
    surgeon.wait_state("Pointer", "done")

    # the skull is swept and the path is shown on it by the mouse in the 3D scene
    for step, finish, half_mm, spacing_mm, places in (
        ("Surface", "Finish strokes", 29.0, 3.5, 5),
        ("Path", "Finish stroke", 24.0, 4.5, 6),
    ):
        surgeon.open_step(step)
        surgeon.button("Draw on the skull").click()
        frame.get_by_text("so far").wait_for()
        assert hand.draw_meander(surgeon, center, half_mm, spacing_mm, places) >= 50
        assert {"/drawing/line", "/drawing/points"} <= set(surgeon.nodes())
        surgeon.picture(step.lower())
        surgeon.button(finish).click()
        surgeon.wait_state(step, "done")
        wait_for(lambda: "/drawing/line" not in surgeon.nodes(), "the line to be recorded")
    wait_for(lambda: "/path/raw" in surgeon.nodes(), "the path in the scene")

    surgeon.open_step("Smoothing")
    surgeon.button("Smooth the path").click()
    surgeon.wait_state("Smoothing", "done")
    surgeon.picture("smoothing")
    surgeon.open_step("Roll")
    surgeon.button("Plan motion").click()
    surgeon.wait_state("Roll", "done")
    surgeon.tab("Rolls")
    frame.get_by_text("°, verified.").filter(visible=True).first.wait_for()
    surgeon.picture("roll")
    surgeon.open_step("Scan")
    hand.unfold(surgeon, "Probe mounting")
    hand.carry_out(surgeon, "Record on gauge plate")
    surgeon.button("Scan").click()
    surgeon.wait_state("Scan", "done")
    surgeon.tab("A-scan")
    surgeon.picture("scan")
    surgeon.open_step("Maps")
    tilted = [f"Scan tilted pass {number} of 4" for number in range(1, 5)]
    for button in ("Map the boundaries", "Plan tilted passes", *tilted, "Map with tilted passes"):
        hand.carry_out(surgeon, button)
    surgeon.wait_state("Maps", "done")
    within_limits(surgeon)
    wait_for(lambda: any("Inner boundary" in row for row in quality(surgeon)), "figures")
    surgeon.picture("maps")
    for words, node in MAPS.items():
        surgeon.field("Show").click()
        frame.get_by_role("option", name=words, exact=True).filter(visible=True).click()
        wait_for(lambda node=node: maps_seen(surgeon) == {node}, words)
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
    page.locator("#save").click()
    wait_for(lambda: surgeon.saved() == "saved", "the file")
    assert counted(surgeon) == 0

    # gone, and opened again: the same states, figures and scene
    states, figures, nodes = surgeon.states(), quality(surgeon), surgeon.nodes()
    assert states[:-1] == ["done"] * (len(STEPS) - 1)  # the bone may be too thin for a bed
    surgeon.menu("sessionbutton", "New session")
    wait_for(lambda: surgeon.states()[1] == "ready", "a new session")
    wait_for(lambda: "/maps/inner" not in surgeon.nodes(), "the maps to go")
    page.locator("#logo").click()
    card = page.locator("#homefiles .card").filter(has_text="Bone")
    card.locator("img").wait_for()  # of the maps, taken when it was saved
    card.click()
    surgeon.wait_state("Maps", "done")
    surgeon.come()  # the page anew: nothing that is shown may live in the browser
    surgeon.open_step("Implant bed")  # the figures of the open step stand first
    wait_for(lambda: quality(surgeon) == figures, "the figures to come back")
    assert surgeon.states() == states
    wait_for(lambda: surgeon.nodes() == nodes, "the scene to come back")
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


@pytest.mark.ci
def test_all_steps_by_keys_alone(surgeon: Surgeon) -> None:
    new_session(surgeon)
    count(surgeon, "pointerdown")
    surgeon.button("Continue: Move and register").wait_for()  # once the figures are known
    surgeon.page.keyboard.press("Control+Shift+Enter")  # opens the tool's step and runs it
    surgeon.wait_state("Tool", "done")
    for step in STEPS[2:9]:
        keyboard.go_to(surgeon, step)
        wait_for(surgeon.button("Cancel").is_hidden, "the step to be free")
        if step == "Scan":
            keyboard.open_folder(surgeon, "Probe mounting")
            keyboard.press(surgeon, "Record on gauge plate")
        surgeon.page.keyboard.press("Control+Enter")
        surgeon.wait_state(step, "done")
        surgeon.wait_idle()
    keyboard.press(surgeon, "Plan tilted passes")
    for number in range(1, 5):
        keyboard.press(surgeon, f"Scan tilted pass {number} of 4")
    keyboard.open_folder(surgeon, "Sound speed calibration")
    keyboard.press(surgeon, "Measure with caliper")
    keyboard.press(surgeon, "Map the boundaries")
    within_limits(surgeon)

    keyboard.go_to(surgeon, "Implant bed")
    surgeon.page.keyboard.press("Control+Enter")
    surgeon.wait_state("Implant bed", "done")
    surgeon.button("Plan milling").wait_for()  # once the bed's milling is known
    keyboard.press(surgeon, "Plan milling")
    keyboard.press(surgeon, "Rehearse milling")
    surgeon.frame.get_by_text("Rehearsed: ").wait_for()
    assert counted(surgeon) == 0
    assert surgeon.errors == []


def with_ur10(surgeon: Surgeon) -> None:
    """Choose another arm."""
    hand.unfold(surgeon, "Robot")
    surgeon.field("Arm").click()
    surgeon.frame.get_by_role("option", name="UR10").click()
    arm = lambda: surgeon.ask("/sessions/current")["setup"]["devices"]["robot"]["model"]  # noqa: E731
    wait_for(lambda: arm() == "ur10", "the other arm")


def with_skull_c(surgeon: Surgeon) -> None:
    """Load a real skull."""
    file = SHARED / "data" / "skull_c_mask.nrrd"
    if not file.is_file():
        pytest.skip(f"{file.name} is not there: set RONA_SHARED to the folder that holds data/")
    hand.unfold(surgeon, "Load a skull")
    hand.choose_file(surgeon, "Load skull file", file)
    wait_for(lambda: surgeon.field("Skull").input_value() == "From a file", "the skull")
    surgeon.wait_idle()


@pytest.mark.parametrize("choose", [with_ur10, with_skull_c])
def test_nine_steps_by_single_clicks_on_another_bone_and_with_another_arm(
    surgeon: Surgeon, choose: Any
) -> None:
    new_session(surgeon)
    surgeon.open_step("Set-up")
    choose(surgeon)
    count(surgeon, "pointerdown")
    looked_at = 0
    for step in PRIMARY:
        if step == "Scan":
            assert counted(surgeon) == TO_PLAN + looked_at
        looked_at += run_next(surgeon, step)
    assert counted(surgeon) == TO_MAPS + looked_at <= MOST  # and nothing typed
    within_limits(surgeon)
    assert surgeon.errors == []
