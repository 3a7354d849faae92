"""Hands on the keyboard alone: they reach by Tab what they press."""

from tests.helpers.ui.browser_driver import STEPS, Surgeon, wait_for

MOST_TABS = 200  # from one end of the page to the other
FOCUSED = """() => {
  const at = document.activeElement;
  return at ? (at.getAttribute('aria-label') || at.textContent || '').trim() : '';
}"""


def focused(surgeon: Surgeon) -> str:
    """Return the name of what has the focus, in the docks or in the bar."""
    return surgeon.frame.evaluate(FOCUSED) or surgeon.page.evaluate(FOCUSED)


def tab_to(surgeon: Surgeon, name: str) -> None:
    """Press Tab until something of this name has the focus."""
    passed: list[str] = []
    for _ in range(MOST_TABS):
        now = focused(surgeon)
        if now.startswith(name):
            return
        passed.append(now[:30])
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
