"""Layout by bounding boxes at four sizes: one-line steps, results above the fold, no overlaps."""

from itertools import combinations

import pytest

from tests.helpers.ui.browser_driver import SMALL, STEPS, Surgeon, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.slow]
SIZES = ((1280, 720), (1440, 900), (1920, 1080), (900, 700))
CROWDED = {"Path": True, "Roll": True, "Maps": True, "Implant bed": True}  # with a legend or not
ROW_PX, OPEN_ROW_PX = 26, 40
SCENE_PX = 400  # that the docks leave to the scene at least
Box = tuple[str, float, float, float, float]  # words, left, top, right, bottom
BOXES = """(kinds) => [...document.querySelectorAll(kinds)].map((e) => {
  const box = e.getBoundingClientRect(), words = (e.innerText || e.ariaLabel || e.className).trim();
  return [words, box.left, box.top, box.right, box.bottom];
}).filter((b) => b[3] > b[1] && b[4] > b[2])"""
DOCKS = "[data-dock-region], [data-floating-window]"
SHEET = "[data-dock-region=left] "
WIDE_OPEN = "() => document.querySelectorAll('[data-dock-region-collapse]').length"


def boxes(frame: object, kinds: str) -> list[Box]:
    """Return words and places of what is to be seen."""
    return [tuple(box) for box in frame.evaluate(BOXES, kinds)]  # type: ignore[attr-defined]


def covered(seen: list[Box]) -> list[tuple[str, str]]:
    """Return the pairs that lie over one another by more than a pixel."""
    return [
        (one[0], other[0])
        for one, other in combinations(seen, 2)
        if min(one[3], other[3]) - max(one[1], other[1]) > 1
        and min(one[4], other[4]) - max(one[2], other[2]) > 1
    ]


def look(surgeon: Surgeon, width: int, height: int) -> None:
    """Take another size, and wait until the docks have followed."""
    surgeon.page.set_viewport_size({"width": width, "height": height})
    wanted = 2 if width > 1150 else 1
    wait_for(lambda: surgeon.frame.evaluate(WIDE_OPEN) == wanted, "the docks to follow")
    wait_for(lambda: surgeon.frame.evaluate("() => innerWidth") == width, "the new size")


def assert_in_place(surgeon: Surgeon, step: str, width: int) -> None:
    """Hold the open step against what is asked of the layout."""
    frame = surgeon.frame
    bottom = frame.evaluate("() => innerHeight")
    rows = boxes(frame, ".r-step")
    assert len(rows) == 10
    assert [row[4] - row[2] <= ROW_PX for row in rows].count(False) == 1  # the active one
    assert max(row[4] - row[2] for row in rows) <= OPEN_ROW_PX
    assert covered(rows) == []
    lines = boxes(frame, ".r-step:not(.on) .t")
    assert max(line[4] - line[2] for line in lines) < 20  # not broken
    result = boxes(frame, f"{SHEET}.r-note")[0]
    all_buttons = boxes(frame, f"{SHEET}button")
    buttons = [next(box for box in all_buttons if box[0].endswith("again"))]  # the primary one
    buttons += [box for box in all_buttons if box[0].startswith("Next: ")]
    assert len(buttons) == (1 if step == STEPS[-1] else 2)
    legends = boxes(frame, f"{SHEET}.r-key, {SHEET}.r-bar")
    assert bool(legends) == CROWDED[step]
    for seen in (*rows, result, *buttons, *legends[:1]):
        assert 0 <= seen[2] < seen[4] <= bottom, (step, width, seen)
    wait_for(lambda: not covered(boxes(frame, DOCKS)), f"{step} {width}: the replay to follow", 20)
    docks = boxes(frame, DOCKS)
    assert len(docks) == (2 if step == "Path" else 3)  # with the replay
    assert all(0 <= dock[1] and dock[3] <= width for dock in docks)
    left, right = sorted(docks, key=lambda dock: dock[1])[0], max(docks, key=lambda dock: dock[3])
    assert right[1] - left[3] >= SCENE_PX


def test_results_are_above_the_fold_and_nothing_is_covered(surgeon: Surgeon) -> None:
    for step in CROWDED:
        surgeon.open_step(step)
        for width, height in SIZES:
            look(surgeon, width, height)
            wait_for(lambda: boxes(surgeon.frame, f"{SHEET}.r-note"), "its result")
            assert_in_place(surgeon, step, width)
            tools = boxes(surgeon.page, ".bar > *, .bar .tool, .bar button, .bar .name")
            inside = [tool for tool in tools if tool[3] > width]
            assert inside == []
            buttons = boxes(surgeon.page, ".bar button")
            assert covered(buttons) == []
    assert surgeon.errors == []


def test_where_there_is_no_room_one_dock_is_open(surgeon: Surgeon) -> None:
    frame = surgeon.frame
    open_docks = (
        "() => [...document.querySelectorAll('[data-dock-region-collapse]')].map("
        "(e) => e.dataset.dockRegionCollapse)"
    )
    look(surgeon, *SIZES[0])
    assert frame.evaluate(open_docks) == ["left", "right"]
    look(surgeon, *SIZES[-1])
    assert frame.evaluate(open_docks) == ["left"]
    surgeon.tab("Log")
    wait_for(lambda: frame.evaluate(open_docks) == ["right"], "the other dock alone")
    wait_for(lambda: not covered(boxes(frame, DOCKS)), "the replay to follow", 20)
    frame.locator("[data-dock-region=left] [data-dock-tab]").first.click()
    wait_for(lambda: frame.evaluate(open_docks) == ["left"], "the steps alone")
    look(surgeon, SMALL["width"], SMALL["height"])
    assert frame.evaluate(open_docks) == ["left", "right"]
