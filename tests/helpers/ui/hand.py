"""A hand at the mouse: it picks the region, pivots the pointer, sweeps, and draws on the skull."""

import re
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.helpers.ui.browser_driver import PAUSE_S, Surgeon, wait_for

MOVE_S = 0.03  # between two moves of a hand while a pivot is recorded in real time
ARC = 0.65  # radius of a handle over the size of all handles
BESIDE_PX = 7.0  # of the middle of a handle: no hand hits a thin arc
TILT_RAD = np.deg2rad(28.0)
HANDLES = """(places) => {
  const m = window.__viserMutable, node = m.nodeRefFromName['/pivot_handles'];
  node.updateWorldMatrix(true, false);
  const box = m.canvas.getBoundingClientRect();
  return places.map((p) => {
    const v = node.position.clone().set(...p).applyMatrix4(node.matrixWorld).project(m.camera);
    return [box.left + (v.x + 1) / 2 * box.width, box.top + (1 - v.y) / 2 * box.height];
  });
}"""
HANDLES_SHOWN = """() => '/pivot_handles' in window.__viserSceneTree.getState()
  && Boolean(window.__viserMutable.nodeRefFromName['/pivot_handles'])"""
# pixels of the page that a millimetre takes at a place in base (mm), across the view
SCALE = """(p) => {
  const m = window.__viserMutable, node = m.nodeRefFromName['/skull'];
  const at = node.position.clone().set(...p.map((mm) => mm / 1000)).applyMatrix4(node.matrixWorld);
  const depth = -at.applyMatrix4(m.camera.matrixWorldInverse).z;
  const height = m.canvas.getBoundingClientRect().height;
  return height / 2000 * m.camera.projectionMatrix.elements[5] / depth;
}"""
UNFOLDED = "(title) => title.nextElementSibling.style.overflow !== 'hidden'"
HEARD = """() => {
  window.heard = [];
  for (const kind of ['pointerdown', 'pointerup', 'click', 'blur']) {
    window.addEventListener(kind, ({ target }) => window.heard.push(
      `${kind} on ${target.tagName} ${target.textContent?.trim().slice(0, 20)}`), true);
  }
}"""
CAMERA = "() => window.__viserMutable.camera.matrixWorld.elements.map((e) => e.toFixed(4)).join()"


def camera_rests(surgeon: Surgeon) -> None:
    """Wait until the camera has arrived where the step wants it."""
    seen = [""]

    def rests() -> bool:
        before, seen[0] = seen[0], surgeon.frame.evaluate(CAMERA)
        return before == seen[0]

    wait_for(rests, "the camera to rest")


def region(surgeon: Surgeon) -> Any:
    """Return the region of the open session, as REST tells of it."""
    return surgeon.ask("/sessions/current")["setup"]["region"]


def region_center(surgeon: Surgeon) -> np.ndarray:
    """Read the centre of the region in base (mm) from what the set-up step says."""
    words = surgeon.frame.get_by_text("Region: centre").inner_text()
    found = re.search(r"\((-?\d+), (-?\d+), (-?\d+)\)", words)
    assert found is not None
    return np.array([float(part) for part in found.groups()])


def pick_region(surgeon: Surgeon, offset_mm: tuple[float, float, float]) -> np.ndarray:
    """Pick the region by a click beside where it is; return its new centre on the skull."""
    place = region_center(surgeon) + offset_mm
    surgeon.button("Pick region").click()
    surgeon.frame.get_by_text("Click the skull where the centre").wait_for()
    camera_rests(surgeon)
    held = region(surgeon)["center_mesh_mm"]
    surgeon.page.mouse.click(*surgeon.pixels([tuple(place)])[0])
    wait_for(lambda: region(surgeon)["center_mesh_mm"] != held, "the new region")
    surgeon.button("Pick region").wait_for()
    return np.array(region(surgeon)["center_mesh_mm"])


def pivot(surgeon: Surgeon, size_m: float) -> None:
    """Pivot the pointer by hand: tilt it about its tip to and fro, by two of its three handles.

    On a slow machine the time of the recording may be over before they are there.
    """
    start(surgeon, "Pivot by hand")
    there = lambda: surgeon.frame.evaluate(HANDLES_SHOWN)  # noqa: E731
    wait_for(lambda: there() or surgeon.ask("/jobs")[-1]["finished"], "the handles")
    if not there():
        return
    time.sleep(PAUSE_S)  # the camera sets out for its view of the pointer
    camera_rests(surgeon)
    mouse, box = surgeon.page.mouse, surgeon.page.locator("iframe#viewer").bounding_box()
    turns = np.pi / 4.0 + TILT_RAD * np.sin(np.linspace(0.0, 2.0 * np.pi, 49))
    circle = ARC * size_m * np.column_stack((np.cos(turns), np.sin(turns)))
    arcs = np.zeros((2, len(turns), 3))
    for arc, axes in zip(arcs, ((1, 2), (2, 0)), strict=True):  # between which they are
        arc[:, axes] = circle
    for number, arc in enumerate(arcs):
        inside, other = (
            np.array(surgeon.frame.evaluate(HANDLES, each.tolist()))
            for each in (arc, arcs[1 - number])
        )
        along = inside[1] - inside[0]
        beside = BESIDE_PX * np.array((-along[1], along[0])) / np.linalg.norm(along)
        away = np.sign(beside @ (inside[0] - other[0]))  # the other may be as near
        places = inside + away * beside + (box["x"], box["y"])
        mouse.move(*places[0])
        mouse.down()
        for place in places[1:]:
            mouse.move(*place)
            time.sleep(MOVE_S)
        mouse.up()


def points_so_far(surgeon: Surgeon) -> int:
    """Return how many points have been drawn on the skull."""
    words = surgeon.frame.get_by_text("so far").inner_text()
    found = re.search(r"(\d+) points?\b", words)
    return int(found.group(1)) if found else 0


def draw_meander(
    surgeon: Surgeon, center: np.ndarray, half_mm: float, spacing_mm: float, places: int
) -> int:
    """Draw on the skull: drag along rows over the region; return how many points there are.

    Each place of a row is waited for, as by a hand that looks at what it draws.
    """
    mouse, drawn = surgeon.page.mouse, 0
    camera_rests(surgeon)
    middle = np.array(surgeon.pixels([tuple(center)])[0])
    px_per_mm = surgeon.frame.evaluate(SCALE, list(center))
    for number, y in enumerate(np.arange(-half_mm + spacing_mm / 2.0, half_mm, spacing_mm)):
        half = np.sqrt(half_mm**2 - y**2)
        x = np.linspace(-half, half, places) * (-1 if number % 2 else 1)
        for index, place in enumerate(middle + px_per_mm * np.column_stack((x, 0.0 * x + y))):
            mouse.move(*place)
            if index == 0:
                mouse.down()
                continue
            before = drawn

            def follows(before: int = before) -> bool:
                nonlocal drawn
                drawn = points_so_far(surgeon)
                return drawn > before

            wait_for(follows, f"place {index + 1} of row {number + 1} on the skull")
        mouse.up()
    return drawn


def start(surgeon: Surgeon, words: str) -> None:
    """Click a button that starts a job, and wait until that is under way."""
    before = len(surgeon.ask("/jobs"))
    surgeon.button(words).click()
    try:
        wait_for(lambda: len(surgeon.ask("/jobs")) > before, f"the job of {words}")
    except AssertionError as error:
        notes = surgeon.frame.locator(".r-note").all_inner_texts()
        raise AssertionError(f"{error}; the docks say {notes}") from None


def carry_out(surgeon: Surgeon, words: str) -> None:
    """Click a button that starts a job, and wait until that has ended well."""
    start(surgeon, words)
    wait_for(lambda: surgeon.ask("/jobs")[-1]["finished"], f"{words} to end")
    job = surgeon.ask("/jobs")[-1]
    assert job["state"] == "done", job
    surgeon.wait_idle()


def unfold(surgeon: Surgeon, name: str) -> None:
    """Click a folder of the docks that is closed, and wait until it has stopped growing."""
    title = surgeon.frame.get_by_text(name, exact=True).filter(visible=True).first
    title.click()
    wait_for(lambda: title.evaluate(UNFOLDED), f"{name} to unfold")  # what moves is missed


def choose_file(surgeon: Surgeon, name: str, file: Path) -> None:
    """Click a button that asks for a file, and choose one."""
    button = surgeon.button(name)
    surgeon.frame.evaluate(HEARD)
    try:
        with surgeon.page.expect_file_chooser() as chooser:
            button.click()
        chosen = chooser.value
    except Exception as error:
        heard, enabled = surgeon.frame.evaluate("() => window.heard"), button.is_enabled()
        told = f"heard {heard}, enabled {enabled}, connections {surgeon.connections}"
        raise AssertionError(f"{name} asks for no file: {told}") from error
    chosen.set_files(file)
