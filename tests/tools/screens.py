"""Screenshots of all pages, to be looked at: steps, start page, recover question and report.

``python -m tests.tools.screens [FOLDER]`` takes them light and dark, in two sizes.
"""

import sys
import tempfile
import time
from pathlib import Path

from tests.helpers.ui.browser_driver import STEPS, TOKEN, Surgeon, running_browser, wait_for
from tests.helpers.ui.program import Program

SIZES = ((1280, 720), (1920, 1080))
THEMES = ("light", "dark")
SETTLED_S = 0.7  # without a change of what is drawn
DRESSED = """() => document.documentElement.dataset.mantineColorScheme
  === document.documentElement.dataset.theme"""
DOCKED = "() => document.documentElement.dataset.theme + document.body.innerText.length"


def settle(surgeon: Surgeon) -> None:
    """Wait until nothing of the docks and of the scene changes any more."""
    seen: list[object] = [None]

    def rests() -> bool:
        time.sleep(SETTLED_S)
        computing = surgeon.frame.get_by_text("Computing: ").filter(visible=True).count()
        if not surgeon.frame.evaluate(DRESSED):
            return False
        before, seen[0] = seen[0], (surgeon.frame.evaluate(DOCKED), surgeon.nodes())
        return before == seen[0] and not computing

    wait_for(rests, "the page to rest")


class Photographer:
    """Takes what is to be seen, in every size and theme."""

    def __init__(self, surgeon: Surgeon, folder: Path) -> None:
        self.surgeon, self.folder = surgeon, folder
        folder.mkdir(parents=True, exist_ok=True)

    def take(self, name: str, theme: str, size: tuple[int, int]) -> None:
        path = self.folder / f"{name}-{size[0]}-{theme}.png"
        self.surgeon.page.screenshot(path=path)
        print(path, flush=True)

    def look(self, theme: str, size: tuple[int, int]) -> None:
        """Take another size, and the page light or dark."""
        page = self.surgeon.page
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.emulate_media(color_scheme=theme)


def lost_work(program: Program, surgeon: Surgeon) -> None:
    """Have the program killed in the middle of work."""
    surgeon.menu("sessionbutton", "New session")
    wait_for(lambda: surgeon.states()[1:3] == ["ready", "ready"], "a new session")
    surgeon.open_step("Pointer")
    surgeon.button("Pivot and calibrate").click()
    surgeon.wait_state("Pointer", "done")
    program.kill()
    program.start()
    surgeon.page.locator("#lost").wait_for()


def main(folder: Path) -> None:
    """Take all of them."""
    with tempfile.TemporaryDirectory() as sessions, running_browser() as browser:
        program = Program(Path(sessions))
        try:
            page = browser.new_page(viewport={"width": SIZES[0][0], "height": SIZES[0][1]})
            page.set_default_timeout(300_000)
            surgeon = Surgeon(page, f"{program.address}session?token={TOKEN}", folder)
            photographer = Photographer(surgeon, folder)
            views = [(theme, size) for size in SIZES for theme in THEMES]
            lost_work(program, surgeon)
            for theme, size in views:
                photographer.look(theme, size)
                photographer.take("recover", theme, size)
            page.locator("#lostlater").click()
            page.locator("#logo").click()
            page.locator("#homeguide").wait_for()
            for theme, size in views:
                photographer.look(theme, size)
                photographer.take("start", theme, size)
            page.goto(surgeon.address)
            surgeon.come()
            surgeon.open_demo()
            for theme, size in views:
                photographer.look(theme, size)
                for number, step in enumerate(STEPS, start=1):
                    surgeon.open_step(step)
                    settle(surgeon)
                    photographer.take(f"step{number:02d}", theme, size)
            page.goto(f"{program.address}api/v1/sessions/current/report")
            for theme, size in views:
                photographer.look(theme, size)
                photographer.take("report", theme, size)
        finally:
            program.kill()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("build/screens"))
