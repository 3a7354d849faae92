"""Accessibility by axe-core: nothing serious or critical on any step, light and dark."""

from typing import Any

import pytest

from tests.helpers.ui.browser_driver import STEPS, Surgeon, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.slow]
RUN = """async () => {
  const found = await axe.run(document, {
    runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa'], resultTypes: ['violations'],
  });
  return {passes: found.passes.length, violations: found.violations
    .filter((each) => ['serious', 'critical'].includes(each.impact))
    .map((each) => `${each.id}: ${each.nodes.map((node) => node.html.slice(0, 200)).join(' ; ')}`)};
}"""
THEME = "() => document.documentElement.dataset.theme"
# of the open tabs of the docks over what is behind them, which axe-core does not judge
CONTRASTS = """() => {
  const parts = (color) => color.match(/[\\d.]+/g).map(Number);
  const light = (color) => parts(color).slice(0, 3).map((c) => c / 255)
    .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = (element) => {
    const color = getComputedStyle(element).backgroundColor, [, , , alpha = 1] = parts(color);
    return alpha === 1 || !element.parentElement ? color : behind(element.parentElement);
  };
  return [...document.querySelectorAll('[data-dock-tab][aria-selected=true]')].map((tab) => {
    const [dark, bright] = [light(getComputedStyle(tab).color), light(behind(tab))]
      .sort((a, b) => a - b);
    return (bright + 0.05) / (dark + 0.05);
  });
}"""
NAMELESS = """() => {
  const button = document.body.appendChild(document.createElement('button'));
  button.id = 'nameless';
}"""


def audit(surgeon: Surgeon) -> list[str]:
    """Return what axe-core finds serious or critical on the page and in its frame."""
    axe: Any = pytest.importorskip("axe_playwright_python.base")
    for frame in (surgeon.page.main_frame, surgeon.frame):  # it looks into frames that hold it
        if not frame.evaluate("() => 'axe' in window"):  # one held twice answers twice
            frame.evaluate(axe.AXE_FILE_PATH.read_text("utf-8"))
    found = surgeon.page.evaluate(RUN)
    assert found["passes"] > 10
    return found["violations"]


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_no_step_has_a_serious_finding(surgeon: Surgeon, theme: str) -> None:
    if surgeon.page.evaluate(THEME) != theme:
        surgeon.command("Dark mode" if theme == "dark" else "Light mode")
        wait_for(lambda: surgeon.page.evaluate(THEME) == theme, f"the {theme} page")
    found = {}
    for step in STEPS:
        surgeon.open_step(step)
        found[step] = audit(surgeon) and audit(surgeon)  # once more: colours fade into each other
    assert found == {step: [] for step in STEPS}
    contrasts = surgeon.frame.evaluate(CONTRASTS)
    assert len(contrasts) >= 2
    assert min(contrasts) >= 4.5


def test_neither_the_start_page_nor_what_lies_over_it_has_one(surgeon: Surgeon) -> None:
    page = surgeon.page
    page.keyboard.press("Control+k")
    page.locator("#palettefield").wait_for()
    assert audit(surgeon) == []
    page.keyboard.press("Escape")
    page.locator("#logo").click()
    page.locator("#homeguide").wait_for()
    assert audit(surgeon) == []


def test_a_button_without_a_name_would_be_found(surgeon: Surgeon) -> None:
    surgeon.page.evaluate(NAMELESS)
    found = audit(surgeon)
    surgeon.page.evaluate("() => document.getElementById('nameless').remove()")
    assert [each.partition(":")[0] for each in found] == ["button-name"]
