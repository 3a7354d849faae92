"""The procedure by as few clicks as it takes, and a count of what a hand did."""

from tests.helpers.ui.browser_driver import STEPS, Surgeon, wait_for

# the steps behind the set-up, and the words of their primary button
PRIMARY = {
    "Tool": "Move and register",
    "Pointer": "Pivot and calibrate",
    "Surface": "Sweep the region",
    "Path": "Record raster path",
    "Smoothing": "Smooth the path",
    "Roll": "Plan motion",
    "Scan": "Scan",
    "Maps": "Map the boundaries",
}
TO_PLAN, TO_MAPS = 6, 9  # clicks from the set-up to a certified plan, and to maps
MOST = 12  # with the steps that are looked at before it goes on
COUNT = """(event) => {
  window.removeEventListener(window.countedEvent, window.counter, true);
  window.counted = 0;
  window.countedEvent = event;
  window.counter = (each) => { if (each.isTrusted) window.counted += 1; };
  window.addEventListener(event, window.counter, true);
}"""


def count(surgeon: Surgeon, event: str) -> None:
    """Count events of a kind, in the page and in the docks, that a hand made."""
    for frame in (surgeon.page.main_frame, surgeon.frame):
        frame.evaluate(COUNT, event)


def counted(surgeon: Surgeon) -> int:
    """Return how many there were."""
    frames = (surgeon.page.main_frame, surgeon.frame)
    return sum(frame.evaluate("() => window.counted") for frame in frames)


def new_session(surgeon: Surgeon) -> None:
    """Begin a new session; one that is open stays so, unsaved."""
    before = surgeon.ask("/sessions/current")["id"]
    surgeon.menu("sessionbutton", "New session")
    asked = surgeon.page.locator("#leavekeep")

    def there() -> bool:
        if asked.is_visible():
            asked.click()
        return surgeon.ask("/sessions/current")["id"] != before

    wait_for(there, "a new session")
    surgeon.wait_session(surgeon.ask("/sessions/current")["id"])
    wait_for(lambda: surgeon.states()[1:3] == ["ready", "ready"], "its steps")


def mounted(surgeon: Surgeon) -> bool:
    """Return whether the mounting of the probe is calibrated."""
    results = surgeon.ask("/sessions/current/results/scan")["results"]
    return results["mounting"]["value"] is not None


def run_next(surgeon: Surgeon, step: str) -> bool:
    """Run the step behind the one that is open, and wait for its end.

    Returns whether the one that is open had a figure that does not pass, which is to be looked at
    before: that takes a click more. The scan is never started from another step: the gauge plate,
    which is offered before it, opens its step.
    """
    number = STEPS.index(step)
    looked = surgeon.ask("/sessions/current/quality")
    doubtful = [
        row["key"]
        for row in looked
        if row["step"] == STEPS[number - 1].lower() and row["verdict"] in ("review", "fail")
    ]
    if doubtful:
        surgeon.button(f"Next: {number + 1} {step}").click()
    if step == "Scan":
        surgeon.button("Continue: Record on gauge plate").click()
        wait_for(lambda: mounted(surgeon), "the mounting")
        surgeon.wait_idle()
    if doubtful or step == "Scan":
        surgeon.button(PRIMARY[step]).click()
    else:
        surgeon.button(f"Continue: {PRIMARY[step]}").click()
    surgeon.wait_state(step, "done")
    surgeon.wait_idle()
    return bool(doubtful)
