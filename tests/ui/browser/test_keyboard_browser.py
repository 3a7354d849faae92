"""All ten steps with the keyboard alone, from an empty session to a rehearsed milling."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.ui.browser_driver import STEPS, Surgeon, running_server, surgeon_at, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.slow]
MOST_TABS = 200  # from one end of the page to the other
LIMITS = {"outer_rms_mm": 0.35, "inner_rms_mm": 0.85, "thickness_rms_mm": 0.5}
COUNT_PRESSES = """() => {
  window.presses = 0;
  addEventListener('pointerdown', (event) => { if (event.isTrusted) window.presses += 1; }, true);
}"""
FOCUSED = """() => {
  const at = document.activeElement;
  return at ? (at.getAttribute('aria-label') || at.textContent || '').trim() : '';
}"""


@pytest.fixture(scope="module")
def surgeon(
    tmp_path_factory: pytest.TempPathFactory, pictures: Path, browser: Any
) -> Iterator[Surgeon]:
    with (
        running_server(tmp_path_factory.mktemp("sessions"), 40.0) as address,
        surgeon_at(browser, address, pictures) as surgeon,
    ):
        yield surgeon


def focused(surgeon: Surgeon) -> str:
    """Return the name of what has the focus, in the docks or in the bar."""
    return surgeon.frame.evaluate(FOCUSED) or surgeon.page.evaluate(FOCUSED)


def tab_to(surgeon: Surgeon, name: str) -> None:
    """Press Tab until something of this name has the focus."""
    passed: list[str] = []
    for _ in range(MOST_TABS):
        if focused(surgeon).startswith(name):
            return
        passed.append(focused(surgeon)[:30])
        surgeon.page.keyboard.press("Tab")
    raise AssertionError(f"Tab does not reach {name}, only {sorted(set(passed))}")


def press(surgeon: Surgeon, name: str, state: str = "done") -> None:
    """Press a button that Tab reaches, and wait until its job has ended well."""
    before = len(surgeon.ask("/jobs"))
    tab_to(surgeon, name)
    surgeon.page.keyboard.press("Enter")
    wait_for(lambda: len(surgeon.ask("/jobs")) > before, f"the job of {name}")
    wait_for(lambda: surgeon.ask("/jobs")[-1]["finished"], f"{name} to end")
    assert surgeon.ask("/jobs")[-1]["state"] == state, surgeon.ask("/jobs")[-1]
    surgeon.wait_idle()


def open_folder(surgeon: Surgeon, name: str) -> None:
    """Open a folder of the docks that is closed."""
    tab_to(surgeon, name)
    surgeon.page.keyboard.press("Enter")


def go_to(surgeon: Surgeon, step: str) -> None:
    """Open a step by its key."""
    number = STEPS.index(step) + 1
    surgeon.page.keyboard.press(str(number % 10))
    title = f"Step {number}: {step}"
    surgeon.frame.locator(".r-title").get_by_text(title, exact=True).wait_for()


def test_all_steps_by_keys_alone(surgeon: Surgeon) -> None:
    for frame in (surgeon.page.main_frame, surgeon.frame):
        frame.evaluate(COUNT_PRESSES)
    surgeon.command("New session")
    wait_for(lambda: surgeon.states()[1:3] == ["ready", "ready"], "a new session")
    for step in STEPS[1:9]:
        go_to(surgeon, step)
        wait_for(surgeon.button("Cancel").is_hidden, "the step to be free")
        if step == "Scan":
            open_folder(surgeon, "Probe mounting")
            press(surgeon, "Record on gauge plate")
        surgeon.page.keyboard.press("Control+Enter")
        surgeon.wait_state(step, "done")
        surgeon.wait_idle()
    press(surgeon, "Plan second pass")
    press(surgeon, "Scan gaps")
    open_folder(surgeon, "Sound speed calibration")
    press(surgeon, "Measure with caliper")
    press(surgeon, "Map the boundaries")
    rows = {row["key"]: row for row in surgeon.ask("/sessions/current/quality")}
    for key, limit in LIMITS.items():
        assert rows[key]["value"] <= limit, key
    assert rows["coverage_fraction"]["value"] >= 0.9

    go_to(surgeon, "Implant bed")
    surgeon.page.keyboard.press("Control+Enter")
    surgeon.wait_state("Implant bed", "done")
    press(surgeon, "Plan milling")
    press(surgeon, "Rehearse milling")
    surgeon.frame.get_by_text("Rehearsed: ").wait_for()
    for frame in (surgeon.page.main_frame, surgeon.frame):
        assert frame.evaluate("() => window.presses") == 0
    assert surgeon.errors == []
