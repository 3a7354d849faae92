"""Tool bar, palette, keys, focus and docks in a real browser: what each of them really does."""

import html
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from rona_ui.panels.layout.docks import TABS
from tests.helpers.ui import browser_driver as driver
from tests.helpers.ui.browser_driver import STEPS, Surgeon, put, retype, shows, wait_for
from tests.helpers.ui.hand import CAMERA, camera_rests
from tests.helpers.ui.keyboard import focused, tab_to
from tests.helpers.ui.program import Program

pytestmark = [pytest.mark.browser, pytest.mark.slow]
BAR = "undo redo save camera cut layers screenshot report figures palette theme help stop".split()
OUT_OF_SIGHT = """(ids) => ids.filter((id) => {
  const button = document.getElementById(id), box = button.getBoundingClientRect();
  const inside = box.width > 0 && box.left >= 0 && box.top >= 0
    && box.right <= innerWidth && box.bottom <= innerHeight;
  const top = document.elementFromPoint((box.left + box.right) / 2, (box.top + box.bottom) / 2);
  return !inside || !button.contains(top);
})"""
CANCEL = "(id) => fetch('/api/v1/jobs/' + id, {method: 'DELETE'})"
VIEW = "() => document.querySelector('[data-page]').dataset.state"
RIM = "() => [...window.__viserSceneTree.getState()['/skull_rim'].message.props.points].join()"
CANVAS = "() => { const c = window.__viserMutable.canvas; return [c.width, c.height]; }"
NOWHERE = """() => {
  const at = document.activeElement, inside = at.contentDocument;
  return at === document.body || Boolean(inside) && inside.activeElement === inside.body;
}"""
LONG = "Specimen 12 of the second series, left side, after the repair"
MARKUP = "Bone <b>7</b> & co"  # would be markup if it were not escaped
CUT = {"/skull_rim", "/cut_outer", "/cut_inner", "/cut_bone"}  # of a skull that is mapped
FACE = {"/head/face", "/head/sutures"}
LEFT_OUT = {"/robot/link6", "/tracker/camera", "/scan/points"}  # the maps need none of them
SEARCH = {"n_rolls": 720, "roll_from_deg": 0.0, "roll_to_deg": 360.0}
# no two in a row have the same lower tab
BY_TURNS = ("Pointer", "Set-up", "Tool", "Surface", "Scan", "Path", "Maps", "Smoothing", "Roll")
MOST_TABS = 12
TOOL = "Move and register"


@pytest.fixture(scope="module")
def surgeon(
    tmp_path_factory: pytest.TempPathFactory, pictures: Path, browser: Any
) -> Iterator[Surgeon]:
    """A page on the demo session as it is on file; its server keeps files of its own."""
    with (
        driver.running_server(tmp_path_factory.mktemp("bar"), pace=40.0) as address,
        driver.surgeon_at(browser, address, pictures) as surgeon,
    ):
        yield surgeon


def current(surgeon: Surgeon) -> Any:
    return surgeon.ask("/sessions/current")


def radius(surgeon: Surgeon) -> float:
    return current(surgeon)["setup"]["region"]["radius_mm"]


def view(surgeon: Surgeon) -> Any:
    """Return how this page looks at the session, as its docks tell."""
    return json.loads(surgeon.frame.evaluate(VIEW))


def tells(surgeon: Surgeon, what: str, value: Any) -> None:
    wait_for(lambda: view(surgeon)[what] == value, f"{what} to be {value}")


def seen(surgeon: Surgeon, nodes: set[str], there: bool = True) -> None:
    """Wait until all of these nodes are in the scene, or none of them."""
    wanted = nodes if there else set()
    wait_for(lambda: nodes & set(surgeon.nodes()) == wanted, f"{nodes}: {there}")


def opened(surgeon: Surgeon, title: str) -> None:
    surgeon.frame.locator(".r-title").get_by_text(title, exact=True).wait_for()


def rename(surgeon: Surgeon, name: str) -> None:
    put(surgeon, "/commands/RenameSession", {"name": name})
    surgeon.page.locator("#name").get_by_text(name, exact=True).wait_for()


def test_the_tabs_of_the_right_dock_are_those_of_each_step(surgeon: Surgeon) -> None:
    wanted = dict(zip(STEPS, TABS.values(), strict=True))
    tabs = surgeon.frame.locator("[data-dock-strip] [role=tab][aria-selected=true]")
    order = (*BY_TURNS, "Implant bed")
    assert sorted(order) == sorted(STEPS)
    for step in order:
        surgeon.open_step(step)
        told, upper_lower = f"the tabs of {step}", list(wanted[step])
        wait_for(lambda w=upper_lower: [t.strip() for t in tabs.all_inner_texts()] == w, told)


def test_each_camera_of_the_menu_is_another_and_its_key_leads_there_too(surgeon: Surgeon) -> None:
    page, at = surgeon.page, lambda: surgeon.frame.evaluate(CAMERA)
    surgeon.open_step("Maps")
    surgeon.menu("camera")
    entries = [e.inner_text().split("\n") for e in page.locator("#cameramenu .entry").all()]
    page.keyboard.press("Escape")
    assert [name for name, *_ in entries] == view(surgeon)["cameras"]
    keys = {name: key[0].lower() for name, *key in entries if key}
    assert set(keys.values()) == set("ogbftlr")
    time.sleep(driver.PAUSE_S)  # for the camera of the step
    poses: dict[str, str] = {}
    for name in ("Oblique", *(name for name, *_ in entries)):  # one that is not the first
        before = at()
        surgeon.menu("camera", name)
        wait_for(lambda b=before: at() != b, f"{name} to be another")
        camera_rests(surgeon)
        poses[name] = at()
    assert len(set(poses.values())) == len(entries)
    for name, key in keys.items():
        page.keyboard.press(key)
        wait_for(lambda n=name: at() == poses[n], f"{key} to lead to {name}")


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1440, 900)])
def test_every_button_of_the_bar_is_in_sight(surgeon: Surgeon, width: int, height: int) -> None:
    page, before = surgeon.page, surgeon.page.viewport_size
    page.set_viewport_size({"width": width, "height": height})
    plain = page.evaluate(OUT_OF_SIGHT, BAR)
    rename(surgeon, LONG)
    put(surgeon, "/jobs/StartRollSearch", SEARCH)
    page.locator("#progress").wait_for()  # it needs room, as the name does
    full = page.evaluate(OUT_OF_SIGHT, BAR)
    page.evaluate(CANCEL, surgeon.ask("/jobs")[-1]["id"])
    page.locator("#job").wait_for(state="hidden")
    put(surgeon, "/undo", None)
    page.set_viewport_size(before)
    assert (plain, full) == ([], [])


def test_undo_and_redo_of_the_bar_take_a_change_back_and_make_it_again(surgeon: Surgeon) -> None:
    surgeon.open_step("Set-up")
    field, states = surgeon.field("Region radius"), surgeon.states()
    retype(surgeon, field, "31")
    surgeon.page.keyboard.press("Enter")
    wait_for(lambda: radius(surgeon) == 31.0, "the change")
    wait_for(surgeon.page.locator("#redo").is_disabled, "nothing to be made again")
    for button, value in (("undo", 25.0), ("redo", 31.0), ("undo", 25.0)):
        surgeon.page.locator(f"#{button}").click()
        wait_for(lambda v=value: radius(surgeon) == v, f"{button} to have its effect")
        shows(field, f"{value:g}")
        wait_for(lambda b=button: (surgeon.states() == states) == (b == "undo"), "the steps")


def test_the_skull_is_cut_by_the_menu_either_way_and_by_x(surgeon: Surgeon) -> None:
    page, menu, rims = surgeon.page, surgeon.page.locator("#cutmenu"), [""]
    surgeon.open_step("Maps")
    seen(surgeon, CUT, False)
    surgeon.menu("cut")
    for words in ("Lengthwise", "Crosswise", "Cut offset"):
        if words == "Cut offset":
            menu.get_by_label(words).focus()
            page.keyboard.press("ArrowRight")
        else:
            menu.get_by_label(words).check()
        seen(surgeon, CUT)
        wait_for(lambda: surgeon.frame.evaluate(RIM) not in rims, f"another cut: {words}")
        rims.append(surgeon.frame.evaluate(RIM))
    wait_for(lambda: view(surgeon)["cut_offset"] == 0.5, "the menu to have moved the cut")
    menu.get_by_label("No cut").check()
    seen(surgeon, CUT, False)
    page.keyboard.press("Escape")
    menu.wait_for(state="hidden")
    for cut in ("lengthwise", "off"):
        page.keyboard.press("x")
        seen(surgeon, CUT, cut != "off")
        tells(surgeon, "cut", cut)


def test_layers_are_hidden_and_shown_by_the_menu_and_all_of_them_by_y(surgeon: Surgeon) -> None:
    page, menu = surgeon.page, surgeon.page.locator("#layersmenu")
    surgeon.open_step("Maps")
    seen(surgeon, LEFT_OUT, False)
    surgeon.menu("layers")
    for words, nodes, shown in (
        ("Face and sutures", FACE, False), ("Face and sutures", FACE, True),
        ("All layers", LEFT_OUT, True), ("All layers", LEFT_OUT, False),
    ):  # fmt: skip
        seen(surgeon, nodes, not shown)
        menu.get_by_label(words).set_checked(shown)
        seen(surgeon, nodes, shown)
    page.keyboard.press("Escape")
    for shown in (True, False):
        page.keyboard.press("y")
        seen(surgeon, LEFT_OUT, shown)
        tells(surgeon, "all_layers", shown)


def test_the_figures_of_the_paper_open_on_a_page_of_their_own(surgeon: Surgeon) -> None:
    with surgeon.page.context.expect_page() as made:
        surgeon.page.locator("#figures").click()
    page = made.value
    try:
        page.get_by_role("heading", name="Figure 10: 3D reconstruction").wait_for()
        image = page.get_by_role("img", name="Registrations.")
        image.scroll_into_view_if_needed()
        wait_for(lambda: image.evaluate("(i) => i.complete && i.naturalWidth > 0"), "a figure")
        page.wait_for_load_state("networkidle")  # else the server ends while one is drawn
    finally:
        page.close()


def test_the_report_tells_the_name_of_the_session(surgeon: Surgeon, tmp_path: Path) -> None:
    rename(surgeon, MARKUP)
    with surgeon.page.expect_download() as download:
        surgeon.page.locator("#report").click()
    assert download.value.suggested_filename == "Bone _b_7__b_ _ co.html"
    download.value.save_as(tmp_path / "report.html")
    words = (tmp_path / "report.html").read_text("utf-8")
    assert words.lower().startswith("<!doctype html>")
    assert html.escape(MARKUP) in words
    assert MARKUP not in words
    put(surgeon, "/undo", None)


@pytest.mark.parametrize("way", ["button", "key"])
def test_a_screenshot_is_a_picture_of_the_scene(surgeon: Surgeon, tmp_path: Path, way: str) -> None:
    surgeon.open_step("Maps")
    name = current(surgeon)["name"]
    surgeon.page.locator("#name").get_by_text(name, exact=True).wait_for()  # it was renamed before
    with surgeon.page.expect_download() as download:
        if way == "key":
            surgeon.page.keyboard.press("p")
        else:
            surgeon.page.locator("#screenshot").click()
    assert download.value.suggested_filename == f"{name} maps.png"
    download.value.save_as(tmp_path / "scene.png")
    with Image.open(tmp_path / "scene.png") as picture:
        assert picture.format == "PNG"
        assert list(picture.size) == surgeon.frame.evaluate(CANVAS)
        assert len(picture.convert("RGB").getcolors(1 << 24)) > 100  # an empty one has one


def test_the_palette_lists_every_group_and_does_what_is_typed(surgeon: Surgeon) -> None:
    page, name, found = surgeon.page, current(surgeon)["name"], {}
    surgeon.open_step("Maps")
    rename(surgeon, LONG)
    page.keyboard.press("Control+k")
    for item in page.locator("#palettelist li").all():
        group, words = item.locator("small").inner_text(), item.locator("span").inner_text()
        found.setdefault(group, []).append(words)
    page.keyboard.press("Escape")
    assert {"Step", "Layers", "Scene", "Page"} <= set(found)
    assert found["Steps"] == [f"{i} {step}" for i, step in enumerate(STEPS, start=1)]
    assert found["Camera"] == view(surgeon)["cameras"]
    assert found["Cut"] == ["No cut", "Cut lengthwise", "Cut crosswise"]
    assert {"Save", "Rename…", "Report", "Close session"} <= set(found["Session"])
    assert found["Edit"] == ["Undo"]

    surgeon.command("undo")
    wait_for(lambda: current(surgeon)["name"] == name, "the name as it was")
    camera = surgeon.frame.evaluate(CAMERA)
    surgeon.command("camera lateral l")
    wait_for(lambda: surgeon.frame.evaluate(CAMERA) != camera, "another camera")
    surgeon.command("cut length")
    seen(surgeon, CUT)
    surgeon.command("no cut")
    seen(surgeon, CUT, False)
    for shown in (True, False):
        surgeon.command("layers all")
        seen(surgeon, LEFT_OUT, shown)
        tells(surgeon, "all_layers", shown)
    surgeon.command("steps smooth")
    opened(surgeon, "Step 6: Smoothing")


def test_cut_lengthwise_of_the_palette_does_so_after_a_cut_crosswise(surgeon: Surgeon) -> None:
    surgeon.command("cut crosswise")
    tells(surgeon, "cut", "crosswise")
    surgeon.command("cut lengthwise")
    wait_for(lambda: view(surgeon)["cut"] != "crosswise", "another cut")
    cut = view(surgeon)["cut"]
    surgeon.command("no cut")
    tells(surgeon, "cut", "off")
    assert cut == "lengthwise"


def test_n_opens_the_next_step_where_there_is_one(surgeon: Surgeon) -> None:
    for step, title in (("Set-up", "Step 2: Tool"), ("Maps", "Step 10: Implant bed")):
        surgeon.open_step(step)
        surgeon.button("Next: ").wait_for()
        surgeon.page.keyboard.press("n")
        opened(surgeon, title)
    surgeon.button("Next: ").wait_for(state="hidden")
    surgeon.page.keyboard.press("n")
    time.sleep(driver.PAUSE_S)
    opened(surgeon, "Step 10: Implant bed")


def test_developers_parts_of_the_viewer_are_seen_only_with_dev(
    surgeon: Surgeon, browser: Any, pictures: Path
) -> None:
    def parts(frame: Any) -> list[int]:
        """Count what is seen: switch, connection; tree, settings, address of the websocket."""
        icons = (frame.locator(f".tabler-icon-{i}") for i in ("adjustments", "cloud-check"))
        words = (frame.get_by_text(words) for words in ("Scene tree", "Dev Settings"))
        address = frame.locator("input[value^='ws://']")
        return [part.filter(visible=True).count() for part in (*icons, *words, address)]

    assert surgeon.frame.locator(".tabler-icon-adjustments").count() == 1
    assert parts(surgeon.frame) == [0] * 5
    with driver.surgeon_at(browser, f"{surgeon.address}&dev", pictures) as developer:
        assert parts(developer.frame) == [1, 1, 0, 0, 0]
        developer.frame.locator(".tabler-icon-adjustments").click()
        wait_for(lambda: parts(developer.frame)[2:] == [1] * 3, "what is behind the switch")


def test_ctrl_s_saves_with_what_is_being_typed(surgeon: Surgeon) -> None:
    surgeon.open_step("Set-up")
    assert "not saved" in surgeon.saved()
    retype(surgeon, surgeon.field("Region radius"), "33")
    assert (radius(surgeon), current(surgeon)["file"]) == (25.0, None)
    surgeon.page.keyboard.press("Control+s")
    wait_for(lambda: surgeon.saved() == "saved", "the file")
    assert radius(surgeon) == 33.0
    files = [each["file"] for each in surgeon.ask("/files")["files"]]
    assert files == [current(surgeon)["file"]]
    put(surgeon, "/undo", None)
    wait_for(lambda: "not saved" in surgeon.saved(), "the change since")


@pytest.mark.parametrize(
    ("on", "key"), [(TOOL, "Enter"), (TOOL, "Control+Enter"), ("Step 2: Tool", "Control+Enter")]
)
def test_the_focus_outlives_a_job_that_is_started_by_key(
    surgeon: Surgeon, on: str, key: str
) -> None:
    page, before = surgeon.page, len(surgeon.ask("/jobs"))
    surgeon.open_step("Tool")
    tab_to(surgeon, on)
    page.keyboard.press(key)
    surgeon.button("Cancel").wait_for()
    wait_for(lambda: not page.evaluate(NOWHERE), "the focus while it runs")
    wait_for(lambda: surgeon.ask("/jobs")[-1]["finished"], "the job to end")
    assert len(surgeon.ask("/jobs")) == before + 1
    surgeon.wait_idle()
    surgeon.button("Next: ").wait_for()
    time.sleep(driver.PAUSE_S)  # for all that comes after the end
    assert not page.evaluate(NOWHERE)
    passed = [focused(surgeon)]
    while not passed[-1].startswith("Next: 3 Pointer"):
        assert len(passed) <= MOST_TABS, passed
        page.keyboard.press("Tab")
        passed.append(focused(surgeon))
    page.keyboard.press("Enter")
    opened(surgeon, "Step 3: Pointer")
    assert surgeon.errors == []


def test_the_page_loads_anew_when_its_program_does_and_its_docks_live(
    tmp_path: Path, browser: Any, pictures: Path
) -> None:
    program = Program(tmp_path)
    address = f"{program.address}session?token={driver.TOKEN}"
    try:
        with driver.surgeon_at(browser, address, pictures) as surgeon:
            page, held = surgeon.page, surgeon.frame
            program.kill()
            page.locator("#link[data-state=down]").wait_for()
            with page.expect_event("load"):
                program.start()
            frames = lambda: [f for f in page.frames if "/viewer" in f.url and f != held]  # noqa: E731
            surgeon.frame = wait_for(frames, "the docks anew")[0]
            page.locator("#splash").wait_for(state="hidden")
            surgeon.open_step("Set-up")
            put(surgeon, "/commands/SetRegion", {"radius_mm": 31.0})
            shows(surgeon.field("Region radius"), "31")  # they follow the new program
            retype(surgeon, surgeon.field("Region radius"), "32")
            page.keyboard.press("Enter")
            wait_for(lambda: radius(surgeon) == 32.0, "what was typed")
            assert surgeon.errors == []
    finally:
        program.kill()
