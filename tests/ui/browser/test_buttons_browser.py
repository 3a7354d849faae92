"""The primary button alone: it ends in the figures of `rona demo` with the same seed."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Error as PlaywrightError

from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.procedure import PROCEDURE, stages
from rona_core.compose import run_demo
from tests.helpers.ui.browser_driver import (
    MADE,
    STEPS,
    Surgeon,
    running_server,
    surgeon_at,
    wait_for,
)
from tests.helpers.ui.clicks import PRIMARY, new_session

pytestmark = [pytest.mark.browser, pytest.mark.slow]
START = {**PRIMARY, "Implant bed": "Search the bed"}
IS_COLOURED = """(button) => {
  const parts = getComputedStyle(button).backgroundColor.match(/[0-9]+/g) || [0, 0, 0];
  const [red, green, blue] = parts.map(Number);
  return Math.max(red, green, blue) - Math.min(red, green, blue) > 40;
}"""
MOST = 40  # clicks: a page that leads in a circle ends here


@pytest.fixture(scope="module")
def surgeon(
    tmp_path_factory: pytest.TempPathFactory, pictures: Path, browser: Any
) -> Iterator[Surgeon]:
    with (
        running_server(tmp_path_factory.mktemp("sessions"), 200.0) as address,
        surgeon_at(browser, address, pictures) as surgeon,
    ):
        yield surgeon


def next_stage(surgeon: Surgeon) -> str:
    """Return what REST says is to be done now; empty where nothing is."""
    found = surgeon.ask("/sessions/current/next")
    return "" if found is None else str(found["name"])


def click_what_leads_on(surgeon: Surgeon) -> str:
    """Click Continue, the primary button of a step that is not done, or Next; return its words.

    One that is grey is not what the page says to do now.
    """

    def found() -> Any:
        surgeon.wait_idle()
        title = surgeon.frame.locator(".r-title").first.inner_text()
        step = next((name for name in STEPS if title.endswith(name)), STEPS[0])
        made = surgeon.states()[STEPS.index(step)] in MADE
        first = () if made or step not in START else (START[step],)
        for words in ("Continue: ", *first, "Next: "):
            button = surgeon.button(words)
            with suppress(PlaywrightError):  # it went as the figures of its step came
                shown = button.is_visible() and button.is_enabled(timeout=3000)
                if shown and button.evaluate(IS_COLOURED, timeout=3000):
                    said = button.inner_text(timeout=3000)
                    button.click(timeout=10_000)  # drawn by software a frame takes seconds
                    return said
        return None

    try:
        return str(wait_for(found, "a button that leads on"))
    except AssertionError as error:
        raise AssertionError(f"{error}: {what_is_shown(surgeon)}") from error


def what_is_shown(surgeon: Surgeon) -> str:
    """Return the title, the states, what is to be done by REST, and every button there is."""
    title = surgeon.frame.locator(".r-title").first.inner_text()
    buttons = [
        f"{button.inner_text()!r} {'' if button.is_enabled() else 'disabled'}"
        for button in surgeon.frame.locator("button:visible").all()
    ]
    return f"{title}, {surgeon.states()}, next {next_stage(surgeon)!r}, {buttons}"


@pytest.mark.parametrize("seed", range(5))
def test_the_primary_button_leads_to_the_figures_of_the_terminal(
    surgeon: Surgeon, seed: int
) -> None:
    new_session(surgeon)
    surgeon.open_step("Set-up")
    field = surgeon.field("Seed")
    field.fill(str(seed))
    field.press("Enter")
    wait_for(lambda: surgeon.ask("/sessions/current")["setup"]["seed"] == seed, "the seed")

    clicked: list[str] = []
    lost = 0  # clicks in a picture that was about to change
    while (stage := next_stage(surgeon)) and len(clicked) < MOST:
        before = surgeon.ask("/sessions/current")["revision"]
        clicked.append(click_what_leads_on(surgeon))
        if not clicked[-1].startswith("Next"):
            changed = lambda was=before: surgeon.ask("/sessions/current")["revision"] > was  # noqa: E731
            try:
                wait_for(changed, f"{stage} after {clicked}", 30.0)
            except AssertionError:
                lost += 1
                assert lost <= 1, clicked
        surgeon.wait_idle()
    assert not stage, clicked
    assert len(clicked) < MOST, clicked

    session, figures = run_demo(seed, among=stages(PROCEDURE[-1].name))
    wanted = {row.key: row.value for row in quality_rows(figures, session)}
    shown = {row["key"]: row["value"] for row in surgeon.ask("/sessions/current/quality")}
    wanted.pop("wall_s")  # of the terminal's run
    differing = {
        key: (shown.get(key), value) for key, value in wanted.items() if shown.get(key) != value
    }
    assert differing == {}
    assert surgeon.errors == []
