"""Clicks and seconds from an empty session to a plan and to maps: a program of its own, no suite.

``python -m benchmarks.suites.procedure.click_through`` does the procedure in the browser of the
tests by as few clicks as it takes, nothing typed, with captures shown as fast as they are computed.
The seconds are those of this machine, waiting for its jobs included.
"""

import tempfile
import time
from pathlib import Path

from benchmarks.reference.yardstick import REFERENCE_S, yardstick_s
from tests.helpers.ui.browser_driver import Surgeon, running_browser, running_server, surgeon_at
from tests.helpers.ui.clicks import MOST, PRIMARY, count, counted, new_session, run_next


def click_through(surgeon: Surgeon) -> dict[str, tuple[int, float]]:
    """Return clicks and seconds to what is there behind the steps 7 and 9."""
    new_session(surgeon)
    surgeon.open_step("Set-up")
    count(surgeon, "pointerdown")
    begun_s, taken = time.monotonic(), {}
    for step in PRIMARY:
        run_next(surgeon, step)
        taken[step] = counted(surgeon), time.monotonic() - begun_s
    return {"a certified plan": taken["Roll"], "maps": taken["Maps"]}


def main() -> None:
    """Print the figures."""
    with (
        tempfile.TemporaryDirectory() as folder,
        running_browser() as browser,
        running_server(Path(folder)) as address,
        surgeon_at(browser, address, Path(folder)) as surgeon,
    ):
        taken = click_through(surgeon)
    for what, (clicks, seconds) in taken.items():
        print(f"to {what}: {clicks} clicks (goal {MOST}), {seconds:.0f} s")
    slower = yardstick_s() / REFERENCE_S
    print(f"this machine takes {slower:.1f} times the {REFERENCE_S:g} s of a yardstick")


if __name__ == "__main__":
    main()
