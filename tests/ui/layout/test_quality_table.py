"""Table of figures: the active step first, what fails on top, and what is still being computed."""

import re
import threading
from dataclasses import replace
from typing import Any

import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.overview.acceptance import pending_figures
from rona_core.app.runtime.handling import handle
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.devices.live import LiveState
from rona_core.session.document import Session
from rona_ui.panels.layout.bars import StepList
from rona_ui.panels.layout.quality import QualityPanel
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.window.background import BackgroundFigures
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.layout.test_one_verdict import NOTHING

FIGURES = {
    "tool_tip_error_mm": 0.21,
    "surface_rms_mm": 0.31,
    "outer_rms_mm": 0.2,
    "inner_rms_mm": 1.0,
    "thickness_rms_mm": 2.0,
}


def snapshot(session: Session, step: str, **parts: Any) -> Snapshot:
    view = ViewState(step=step)
    return Snapshot(session, view, step_states(session), LiveState(), **parts)


def quality(at: Snapshot) -> str:
    gui = FakeGui()
    QualityPanel(gui).render(None, at)
    return gui.html()


def titles(html: str) -> list[str]:
    """Return sections and figures as they stand below each other."""
    return [words.strip() for words in re.findall(r"<tr[^>]*><td[^>]*>([^<]*)", html)]


def test_the_figures_of_the_active_step_come_first_and_stand_there_once(demo: Session) -> None:
    for step, heading, own in (
        ("maps", "Step 9: Maps", "Outer boundary, RMS"),
        ("tool", "Step 2: Tool", "Tool tip error"),
        ("surface", "Step 4: Surface", "Surface cloud, RMS"),
    ):
        seen = titles(quality(snapshot(demo, step, figures=FIGURES, judged=demo)))
        assert seen[0] == heading
        end = next(i for i, words in enumerate(seen[1:], 1) if "ground truth" in words)
        assert own in seen[1:end]
        assert seen.count(own) == 1
    seen = titles(quality(snapshot(demo, "setup", figures=FIGURES, judged=demo)))
    assert seen[0] == "Predicted, without ground truth"  # the set-up has none of its own


def test_what_fails_stands_above_what_is_for_review_and_what_passes(demo: Session) -> None:
    for step in ("maps", "tool"):  # in the section of the active step, and in the others
        seen = titles(quality(snapshot(demo, step, figures=FIGURES, judged=demo)))
        order = ("Thickness, RMS", "Inner boundary, RMS", "Outer boundary, RMS")
        assert sorted(order, key=seen.index) == list(order)


def test_figures_of_maps_that_are_made_anew_are_computing_and_not_those_of_before(
    demo: Session,
) -> None:
    held = demo.results.maps
    assert held is not None
    again = replace(demo, results=replace(demo.results, maps=replace(held)))
    at = snapshot(again, "maps", figures=FIGURES, judged=demo, computing=True)
    html = quality(at)
    assert "Computing: " in html
    assert "Outer boundary, RMS" in html[: html.index("<table")]
    assert "2.00 mm" not in html  # what the maps of before had
    assert "0.31 mm" in html  # the surface is the same
    gui = FakeGui()
    StepList(gui, NOTHING).render(None, at)
    assert "✖ fail" not in gui.html()
    known = quality(snapshot(again, "maps", figures=FIGURES, judged=again))
    assert "Computing" not in known
    assert "2.00 mm" in known


def test_before_the_first_figures_the_table_says_that_they_are_computed(demo: Session) -> None:
    html = quality(snapshot(demo, "maps", computing=True))
    assert "Computing: Tool tip error" in html
    assert "Computing" not in quality(snapshot(Session(), "maps", computing=True))


def test_a_stale_result_is_not_waited_for(demo: Session) -> None:
    stale = handle(SetSeed(4), demo)
    assert "outer_rms_mm" in pending_figures(demo, None)
    assert "outer_rms_mm" not in pending_figures(stale, None)
    assert pending_figures(demo, demo) == frozenset()


class SlowBench:
    """A workbench whose figures take until they are let go."""

    def __init__(self, session: Session) -> None:
        self.session, self.go = session, threading.Event()

    def rig(self) -> Any:
        return None

    def figures(self) -> dict[str, Any]:
        assert self.go.wait(20)
        return {"outer_rms_mm": 0.2}


@pytest.mark.parametrize("fails", [False, True])
def test_computing_lasts_until_the_figures_are_there_or_cannot_be(
    demo: Session, monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    def scene(*_: Any) -> None:
        if fails:
            raise ZeroDivisionError("a defect")

    monkeypatch.setattr("rona_ui.window.background.read_static_scene", scene)
    monkeypatch.setattr("rona_ui.window.background._beside_truth", lambda _: None)
    monkeypatch.setattr("rona_ui.window.background.traceback.print_exc", lambda **_: None)
    woken = threading.Event()
    background, bench = BackgroundFigures(woken.set), SlowBench(demo)
    try:
        assert background.ask(bench, demo, False).computing  # type: ignore[arg-type]
        bench.go.set()
        for _ in range(100):
            if not (state := background.ask(bench, demo, False)).computing:  # type: ignore[arg-type]
                break
            woken.wait(0.2)
            woken.clear()
        assert not state.computing
        assert (state.judged is demo) is not fails
        renamed = replace(demo, name="another name")
        if not fails:
            assert not background.ask(bench, renamed, False).computing  # type: ignore[arg-type]
    finally:
        background.close()
