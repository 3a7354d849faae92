"""What the hand does in the scene is seen while it does it: strokes that grow, modes that show."""

import re
from typing import Any

import pytest

from tests.helpers.ui import browser_driver as driver
from tests.helpers.ui import hand
from tests.helpers.ui.browser_driver import Surgeon, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.slow]
CURSOR = "() => getComputedStyle(document.querySelector('canvas[data-engine]')).cursor"
STROKE_POINTS = """() => {
  const node = window.__viserMutable.nodeRefFromName['/surface/stroke'];
  let count = 0;
  node?.traverse((part) => {  // a dot is a segment, and segments are instances of one
    const parts = part.geometry?.attributes ?? {};
    count += (parts.instanceStart ?? parts.position)?.count ?? 0;
  });
  return count;
}"""
# of the words of the pressed button against what they stand on (WCAG 2)
CONTRAST = """() => {
  const button = document.querySelector('button[aria-pressed=true]');
  const words = [...button.querySelectorAll('*')].find((e) => e.children.length === 0) ?? button;
  const luminance = (color) => {
    const [r, g, b] = color.match(/[\\d.]+/g).map((part) => part / 255)
      .map((part) => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const found = [getComputedStyle(words).color, getComputedStyle(button).backgroundColor];
  const [low, high] = found.map(luminance).sort((a, b) => a - b);
  return (high + 0.05) / (low + 0.05);
}"""
OUTLINES = """() => {
  const found = [];
  window.__viserMutable.nodeRefFromName['/skull'].traverse((part) => {
    const settings = part.material?.uniforms;
    if (settings?.screenspace && settings.thickness) found.push(settings.opacity.value);
  });
  return found;
}"""


def middle(surgeon: Surgeon) -> tuple[float, float]:
    box = surgeon.frame.locator("canvas[data-engine]").bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def ring_px(surgeon: Surgeon) -> float:
    """Return how wide the ring at the cursor is; 0 where it is a cross."""
    found = re.search(r"%20r%3D%22([\d.]+)", surgeon.frame.evaluate(CURSOR))
    return 2.0 * float(found.group(1)) if found else 0.0


def mode(surgeon: Surgeon) -> Any:
    return surgeon.page.locator("#mode")


def draw_two_points(surgeon: Surgeon) -> tuple[float, float]:
    """Begin a stroke on the skull; return the middle of the scene, which it goes about."""
    x, y = middle(surgeon)
    surgeon.button("Draw on the skull").click()
    mode(surgeon).wait_for()
    surgeon.page.mouse.click(x - 80, y)
    wait_for(lambda: "/drawing/points" in surgeon.nodes(), "the first point")
    surgeon.page.mouse.click(x + 80, y + 20)
    wait_for(lambda: "/drawing/line" in surgeon.nodes(), "the line")
    return x, y


@pytest.fixture(scope="module")
def at_surface(surgeon: Surgeon) -> Surgeon:
    surgeon.open_step("Surface")
    hand.camera_rests(surgeon)
    return surgeon


def test_the_stroke_grows_in_the_scene_while_the_pointer_sweeps(at_surface: Surgeon) -> None:
    surgeon = at_surface
    surgeon.button("Sweep the region").click()
    wait_for(lambda: "/surface/stroke" in surgeon.nodes(), "the stroke")
    early = surgeon.frame.evaluate(STROKE_POINTS)
    assert early > 0
    wait_for(lambda: surgeon.frame.evaluate(STROKE_POINTS) > early, "it to grow")
    assert "/surface/cloud" in surgeon.nodes()  # that of before stays in sight
    surgeon.button("Cancel").click()
    surgeon.wait_idle()
    wait_for(lambda: "/surface/stroke" not in surgeon.nodes(), "it to go")
    assert surgeon.errors == []


def test_a_drawn_line_stays_until_the_pointer_has_followed_it(at_surface: Surgeon) -> None:
    surgeon = at_surface
    x, y = draw_two_points(surgeon)
    surgeon.page.mouse.click(x + 80, y + 90)
    surgeon.frame.get_by_text("3 points in 1 stroke so far").wait_for()
    surgeon.button("Undo last point").click()
    surgeon.frame.get_by_text("2 points in 1 stroke so far").wait_for()
    surgeon.button("Finish stroke").click()
    wait_for(lambda: "/surface/stroke" in surgeon.nodes(), "the pointer on its way")
    assert "/drawing/line" in surgeon.nodes()
    surgeon.wait_idle()
    wait_for(lambda: "/drawing/line" not in surgeon.nodes(), "it to be recorded")
    assert surgeon.errors == []


def test_a_line_that_is_drawn_outlives_the_connection_and_the_page(at_surface: Surgeon) -> None:
    surgeon = at_surface
    draw_two_points(surgeon)
    for connect_anew in (lambda: surgeon.frame.evaluate("() => location.reload()"), surgeon.come):
        with surgeon.page.expect_event("websocket"):
            connect_anew()
        surgeon.frame.get_by_text("2 points in 1 stroke so far").wait_for()
        wait_for(lambda: "/drawing/line" in surgeon.nodes(), "the line")
        mode(surgeon).wait_for()
    surgeon.button("Finish stroke").click()
    surgeon.wait_idle()
    wait_for(lambda: "/drawing/line" not in surgeon.nodes(), "it to be recorded")
    assert surgeon.errors == []


def test_the_pointer_is_lifted_between_drags_and_each_stroke_is_recorded(
    at_surface: Surgeon,
) -> None:
    surgeon, mouse = at_surface, at_surface.page.mouse
    before = len(surgeon.ask("/sessions/current")["captures"])
    x, y = middle(surgeon)
    surgeon.button("Draw on the skull").click()
    mode(surgeon).wait_for()
    for number, height in enumerate((-60, 0, 60), start=1):
        mouse.move(x - 80, y + height)
        mouse.down()
        for step in range(1, 9):
            mouse.move(x - 80 + 20 * step, y + height)
        mouse.up()
        words = f"in {number} stroke{'' if number == 1 else 's'} so far"
        surgeon.frame.get_by_text(words).wait_for()
    hand.carry_out(surgeon, "Finish strokes")
    after = surgeon.ask("/sessions/current")["captures"]
    assert len(after) == before + 3
    assert surgeon.errors == []


def test_a_mode_is_told_over_the_scene_by_the_cursor_and_by_its_button(surgeon: Surgeon) -> None:
    surgeon.open_demo()  # its path fits its cloud
    surgeon.open_step("Smoothing")
    mode(surgeon).wait_for(state="hidden")
    for words, told in (("Move", "Moving points"), ("Delete", "Deleting points")):
        button = surgeon.frame.get_by_role("button", name=words, exact=True)
        button.click()
        wait_for(lambda told=told: told in mode(surgeon).inner_text(), "the mode")
        assert surgeon.frame.evaluate(CURSOR) == "crosshair"
        pressed = surgeon.frame.locator("button[aria-pressed=true]")
        wait_for(lambda pressed=pressed, words=words: pressed.all_inner_texts() == [words], words)
        for _ in ("dark", "light again"):
            surgeon.command("mode")
            wait_for(lambda: surgeon.frame.evaluate(CONTRAST) > 4.5, "words that can be read")
    surgeon.page.keyboard.press("Escape")
    mode(surgeon).wait_for(state="hidden")
    assert surgeon.frame.evaluate(CURSOR) != "crosshair"
    wait_for(lambda: not surgeon.frame.locator("button[aria-pressed=true]").count(), "none pressed")


def test_no_outline_hides_the_bone_while_somebody_points_at_it(surgeon: Surgeon) -> None:
    surgeon.open_step("Surface")
    hand.camera_rests(surgeon)
    surgeon.button("Draw on the skull").click()
    mode(surgeon).wait_for()
    x, y = middle(surgeon)
    surgeon.page.mouse.move(x, y)
    wait_for(lambda: surgeon.frame.evaluate(OUTLINES), "the outline of what can be clicked")

    def unseen() -> bool:
        surgeon.page.mouse.move(x + 3, y)
        surgeon.page.mouse.move(x, y)
        return set(surgeon.frame.evaluate(OUTLINES)) == {0}

    wait_for(unseen, "the outline to be unseen")
    surgeon.page.keyboard.press("Escape")


def test_the_cursor_is_as_wide_as_the_face_of_the_probe_or_as_the_brush(surgeon: Surgeon) -> None:
    surgeon.open_demo()
    surgeon.open_step("Set-up")
    center = list(hand.region_center(surgeon))
    surgeon.open_step("Path")
    hand.unfold(surgeon, "Paint regions")
    hand.camera_rests(surgeon)
    for words, width_mm in (("Draw on the skull", 6.35), ("Paint region to avoid", 10.0)):
        surgeon.button(words).click()
        mode(surgeon).wait_for()
        surgeon.page.mouse.move(*middle(surgeon))
        px = width_mm * surgeon.frame.evaluate(hand.SCALE, center)
        wait_for(lambda px=px: abs(ring_px(surgeon) - px) <= 1.0, f"a ring of {px:.0f} pixels")
        surgeon.picture(f"footprint_{width_mm:g}")
    far = ring_px(surgeon)
    surgeon.page.mouse.wheel(0, 400)
    wait_for(lambda: ring_px(surgeon) < far - 2.0, "the ring to shrink as the camera goes away")
    surgeon.page.keyboard.press("Escape")
    assert surgeon.errors == []


def test_a_point_of_the_path_is_chosen_by_number_and_moved_by_the_arrow_keys(
    surgeon: Surgeon,
) -> None:
    surgeon.open_demo()
    surgeon.open_step("Smoothing")
    hand.unfold(surgeon, "Path points")
    keyboard, number = surgeon.page.keyboard, surgeon.field("Point no.")
    place = surgeon.field("Position (mm)")
    held = place.input_value()
    driver.retype(surgeon, number, "5")
    keyboard.press("Enter")
    wait_for(lambda: "Moving points" in mode(surgeon).inner_text(), "the mode")
    wait_for(lambda: place.input_value() != held, "the place of that point")
    revision = surgeon.ask("/sessions/current")["revision"]
    keyboard.press("Tab")
    surgeon.button("Insert point after").focus()
    for key in ("ArrowRight", "ArrowRight", "Shift+ArrowUp"):
        keyboard.press(key)
    changed = lambda: surgeon.ask("/sessions/current")["revision"] - revision  # noqa: E731
    wait_for(changed, "the point to be moved")
    surgeon.frame.get_by_text("1 edited by hand").wait_for()
    assert changed() == 1  # moves in a row are one change
    surgeon.picture("path_points")
    keyboard.press("Escape")
    wait_for(mode(surgeon).is_hidden, "the mode to be left")
    assert surgeon.errors == []
