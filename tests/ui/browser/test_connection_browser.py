"""The viewer's connection in a real browser: it is made once, and the viewer has the focus then."""

from typing import Any

import pytest

from tests.helpers.ui.browser_driver import COARSE, PATIENCE_S, SMALL, Surgeon, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.slow]
# at each focus of the viewer, which connects anew at that moment: its docks are there, or the first
# connection was given up, as the viewer does after 5 s
GIVEN_UP_MS = 5000
WATCH = f"""window.focused = [];
window.addEventListener('focus', () => {{
  const loaded = performance.getEntriesByType('navigation')[0].loadEventEnd;
  window.focused.push(document.querySelector('[data-page]') !== null
    || (loaded > 0 && performance.now() - loaded > {GIVEN_UP_MS}));
}});"""


def test_a_page_does_not_replace_the_connection_that_is_being_made(
    surgeon: Surgeon, browser: Any
) -> None:
    page = browser.new_page(viewport=SMALL)
    page.set_default_timeout(PATIENCE_S * 1000)
    page.add_init_script(COARSE + ";" + WATCH)
    sat_down = Surgeon(page, surgeon.address, surgeon.pictures)
    wait_for(lambda: sat_down.frame.evaluate("document.hasFocus()"), "the viewer's focus")
    focused = sat_down.frame.evaluate("window.focused")
    assert focused
    assert all(focused)
    assert sat_down.connections == ["came"]
    assert sat_down.errors == []
    page.close()
