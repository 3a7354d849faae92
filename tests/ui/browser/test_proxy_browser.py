"""The page in a real browser behind a reverse proxy, and within what its policies let it do."""

from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from tests.helpers.reverse_proxy import proxied
from tests.helpers.ui.browser_driver import STEPS, TOKEN, Surgeon, running_server, surgeon_at

pytestmark = [pytest.mark.browser, pytest.mark.slow]
ROOT = "/lab/rona"


@pytest.mark.parametrize("strip", [True, False], ids=["prefix stripped", "prefix kept"])
def test_page_and_viewer_work_under_a_sub_path(
    tmp_path: Path, pictures: Path, browser: Any, strip: bool
) -> None:
    with (
        running_server(tmp_path, more=("--root-path", ROOT)) as address,
        proxied(urlsplit(address).port or 0, ROOT, strip=strip) as proxy,
    ):
        there = f"http://127.0.0.1:{proxy.port}{ROOT}"
        with surgeon_at(browser, f"{there}/session?token={TOKEN}", pictures) as surgeon:
            assert surgeon.page.url == f"{there}/session"
            assert surgeon.states() == ["done"] * len(STEPS)
            surgeon.open_step("Maps")
            surgeon.page.locator("#logo").click()
            surgeon.page.locator("#home").wait_for(state="visible")
            assert surgeon.page.url == f"{there}/"
            surgeon.page.locator("#homenew").click()
            surgeon.page.locator("#home").wait_for(state="hidden")
            assert surgeon.page.url == f"{there}/session"
            surgeon.page.goto(f"{there}/api/v1/docs")
            surgeon.page.locator("#routes details").first.wait_for()
            assert f"{there}/api/v1;" in surgeon.page.locator("#about").inner_text()
            assert surgeon.errors == []
        assert proxy.strays == []
        assert any("/events" in line for line in proxy.passed)


def test_the_policies_of_page_and_viewer_forbid_nothing_that_they_do(
    surgeon: Surgeon, browser: Any
) -> None:
    said: list[str] = []
    page = browser.new_page()
    page.on("console", lambda message: said.append(message.text))
    visitor = Surgeon(page, surgeon.address, surgeon.pictures)
    for step in STEPS:
        visitor.open_step(step)
    visitor.tab("Joints")
    assert [text for text in said if "Content Security Policy" in text or "Refused" in text] == []
    ran = visitor.frame.evaluate("""() => {
      const made = document.createElement('div');
      made.innerHTML = '<img src="data:," onerror="window.ran = true">';
      document.body.append(made);
      const script = document.createElement('script');
      script.textContent = 'window.ran = true';
      document.body.append(script);
      return new Promise((done) => setTimeout(() => done(window.ran === true), 300));
    }""")
    assert visitor.errors == []
    assert not ran  # what gets into the viewer as markup runs nothing
    page.close()
